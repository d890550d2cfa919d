// server/turns.h — one at a time, in the order in which they came: how sessions share a device.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>

namespace server {

/// A lock that nobody overtakes: a session that draws long frames waits as often as one that draws short ones. Any thread.
class Turns {
public:
    /// Holds the turn as long as it lives.
    class Turn {
    public:
        explicit Turn(Turns& turns) : turns_(turns) { turns_.take(); }
        ~Turn() { turns_.give(); }
        Turn(const Turn&) = delete;
        Turn& operator=(const Turn&) = delete;

    private:
        Turns& turns_;
    };

private:
    void take();
    void give();

    struct Waiter {
        std::condition_variable changed;
        bool called = false;
    };
    std::mutex mutex_;
    std::deque<Waiter*> waiting_;  ///< each sleeps by itself: the end of a turn wakes nobody but the next
    bool taken_ = false;
};

}  // namespace server
