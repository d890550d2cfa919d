#include "cache/statistics.h"

namespace cache {

const char* toString(Cause cause) {
    switch (cause) {
        case Cause::kStart: return "start";
        case Cause::kSun: return "sun";
        case Cause::kRebase: return "rebase";
        case Cause::kJump: return "jump";
        case Cause::kScroll: return "scroll";
        case Cause::kDeparture: return "departure";
        case Cause::kDemotion: return "demotion";
        case Cause::kLevel: return "level";
        case Cause::kEdit: return "edit";
        case Cause::kArrival: return "arrival";
        case Cause::kPromotion: return "promotion";
    }
    return "";
}

}  // namespace cache
