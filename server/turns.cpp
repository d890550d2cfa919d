#include "server/turns.h"

namespace server {

void Turns::take() {
    std::unique_lock lock(mutex_);
    const uint64_t mine = tickets_++;
    next_.wait(lock, [&] { return served_ == mine; });
}

void Turns::give() {
    const std::lock_guard lock(mutex_);
    ++served_;
    next_.notify_all();
}

}  // namespace server
