// server/turns.h — one at a time, in the order in which they came: how sessions share a device.
// Source: Reed & Kanodia, "Synchronization with Eventcounts and Sequencers", 1979 (tickets).
#pragma once

#include <condition_variable>
#include <cstdint>
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

    std::mutex mutex_;
    std::condition_variable next_;
    uint64_t tickets_ = 0, served_ = 0;
};

}  // namespace server
