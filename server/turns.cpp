#include "server/turns.h"

#include <utility>

namespace server {

void Turns::take() {
    std::unique_lock lock(mutex_);
    if (!std::exchange(taken_, true)) return;
    Waiter mine;
    waiting_.push_back(&mine);
    mine.changed.wait(lock, [&] { return mine.called; });
}

void Turns::give() {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) {
        taken_ = false;
        return;
    }
    Waiter& next = *waiting_.front();
    waiting_.pop_front();
    next.called = true;
    next.changed.notify_one();  // under the lock: the waiter is there until it has it
}

}  // namespace server
