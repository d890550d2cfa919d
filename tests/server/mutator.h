// tests/server/mutator.h — random changes of sound messages, for tests that hold a parser to its word.
#pragma once

#include <chrono>
#include <cstring>
#include <limits>
#include <random>
#include <string>

#include "tests/server/clients.h"

namespace tests {

/// Of each target.
constexpr std::chrono::seconds kFuzzTime{60};

class Mutator {
public:
    explicit Mutator(uint64_t seed) : rng_(seed) {}
    size_t below(size_t n) { return rng_() % n; }
    /// A few changes: bytes, doubles that are special, pieces left out, doubled or from elsewhere.
    void change(std::string& bytes, const std::string& other) {
        static constexpr double kSpecial[] = {0, -0.0, 1e308, -1e308, 1e-320, 1e9, -1e9, 1e100, std::numeric_limits<double>::infinity(),
                                              std::numeric_limits<double>::quiet_NaN(), 4294967296.0, 9223372036854775808.0};
        for (size_t n = 1 + below(4); n > 0 && !bytes.empty(); --n) {
            const size_t at = below(bytes.size()), length = std::min(bytes.size() - at, 1 + below(24));
            switch (below(7)) {
                case 0: bytes[at] = char(rng_()); break;
                case 1: bytes[at] = char(bytes[at] ^ (1 << below(8))); break;
                case 2: bytes.erase(at, length); break;
                case 3: bytes.insert(at, bytes.substr(at, length)); break;
                case 4: bytes.insert(at, other.substr(below(other.size()), 1 + below(24))); break;
                default: {
                    // Fields of doubles have wire type 1: after such a tag, most likely, comes one.
                    size_t tag = at;
                    while (tag < bytes.size() && (bytes[tag] & 7) != 1) ++tag;
                    if (tag + 9 > bytes.size()) break;
                    std::memcpy(&bytes[tag + 1], &kSpecial[below(std::size(kSpecial))], 8);
                }
            }
        }
    }

private:
    std::mt19937_64 rng_;
};

/// With all that a frame can ask for.
inline gnomon::v1::Frame richFrame(uint64_t k) {
    gnomon::v1::Frame frame = lifeFrame(k % 40);
    frame.clear_wants();
    frame.mutable_cameras(0)->set_vertical_fov(1);
    put(frame.mutable_sun(), {0.3, -0.9, 0.2});
    gnomon::v1::SpotUpdate* spot = frame.add_spots();
    spot->set_spot(k % 3);
    put(spot->mutable_shine()->mutable_position(), {double(k % 9), 9, 0});
    put(spot->mutable_shine()->mutable_direction(), {0, -1, 0.1});
    spot->mutable_shine()->set_side(64);
    gnomon::v1::ObjectUpdate* update = frame.add_objects();
    update->set_object(k % 5);
    switch (k % 4) {
        case 0: put(update->mutable_spawn()->mutable_placement()->mutable_translation(), {1, 2, 3}); break;
        case 1: update->mutable_mark()->set_deforms(true); break;
        case 2: put(update->mutable_move()->mutable_translation(), {2, 2, 3}); break;
        default: update->mutable_remove();
    }
    frame.add_edits()->mutable_capsule()->set_radius(2);
    frame.mutable_budget()->set_texels(4000);
    frame.mutable_wants()->set_dearest_casters(2);
    return frame;
}

}  // namespace tests
