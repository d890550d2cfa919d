#include "world/reads.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "world/hash.h"

namespace world {
namespace {

FinishedRead perform(const WorldStore& store, ReadRequest request, int thread) {
    FinishedRead done{.request = std::move(request), .times = {}, .chunk = {}, .mesh = {}, .error = {}};
    done.times = {thread, std::chrono::steady_clock::now(), {}};
    const ReadRequest& r = done.request;
    if (r.mesh) {
        Result<Mesh> mesh = store.readMesh(*r.mesh);
        if (mesh) done.mesh = std::make_unique<const Mesh>(std::move(mesh.value()));
        else done.error = mesh.error();
    } else {
        Result<Chunk> chunk = store.readChunk(store.chunks()[r.record].key, r.firstLevel, r.base.get());
        if (chunk) done.chunk = std::make_shared<const Chunk>(std::move(chunk.value()));
        else done.error = chunk.error();
    }
    done.times.end = std::chrono::steady_clock::now();
    return done;
}

/// All of them on all of TBB's threads; appended in order.
void performAll(const WorldStore& store, std::vector<ReadRequest>& requests, std::vector<FinishedRead>& finished) {
    const size_t first = finished.size();
    finished.resize(first + requests.size());
    tbb::parallel_for(size_t{0}, requests.size(),
                      [&](size_t i) {
                          finished[first + i] = perform(store, std::move(requests[i]), tbb::this_task_arena::current_thread_index());
                      });
    requests.clear();
}

class LockStepReads : public Reads {
public:
    explicit LockStepReads(const WorldStore& store) : store_(store) {}
    void ask(ReadRequest request, double) override { asked_.push_back(std::move(request)); }
    void collect(double, std::vector<FinishedRead>& finished) override { performAll(store_, asked_, finished); }
    size_t underWay() const override { return asked_.size(); }

private:
    const WorldStore& store_;
    std::vector<ReadRequest> asked_;
};

/// Numbers that depend on a seed and a place alone, uniform in [0, 1).
class Dice {
public:
    Dice(uint64_t seed, uint64_t place, uint64_t purpose) : state_{seed, place, purpose} {}
    double operator()() {
        state_[3]++;
        return double(hashValues(std::span<const uint64_t>(state_)) >> 11) * 0x1p-53;
    }

private:
    uint64_t state_[4];
};

class VirtualReads : public Reads {
public:
    VirtualReads(const WorldStore& store, const DiskModel& disk)
        : store_(store), disk_(disk), freeAt_(static_cast<size_t>(disk.channels), 0.0) {}

    void ask(ReadRequest request, double now) override {
        Dice dice(disk_.seed, asked_++, 1);
        // Twelve uniform numbers make a normal one, near enough and the same on every machine.
        double normal = -6;
        for (int i = 0; i < 12; ++i) normal += dice();
        double seconds = disk_.latency * std::exp(disk_.spread * normal) +
                         double(request.bytes) / disk_.bandwidth * disk_.channels;
        if (dice() < disk_.stallShare) seconds += disk_.stallSeconds;
        const bool fails = dice() < disk_.failShare;
        double& channel = *std::min_element(freeAt_.begin(), freeAt_.end());
        channel = std::max(channel, now) + seconds;
        Pending pending{std::move(request), channel, fails};
        const auto after = std::upper_bound(pending_.begin(), pending_.end(), pending.ends,
                                            [](double ends, const Pending& p) { return ends < p.ends; });
        pending_.insert(after, std::move(pending));
    }

    void collect(double now, std::vector<FinishedRead>& finished) override {
        std::vector<ReadRequest> requests;
        const auto clock = std::chrono::steady_clock::now();
        while (!pending_.empty() && pending_.front().ends <= now) {
            Pending p = std::move(pending_.front());
            pending_.pop_front();
            if (const auto error = refused(p)) {
                finished.push_back({.request = std::move(p.request), .times = {0, clock, clock}, .chunk = {}, .mesh = {}, .error = error});
                continue;
            }
            requests.push_back(std::move(p.request));
        }
        performAll(store_, requests, finished);
    }

    size_t underWay() const override { return pending_.size(); }

private:
    struct Pending {
        ReadRequest request;
        double ends = 0;
        bool fails = false;
    };
    std::optional<Error> refused(const Pending& p) const {
        if (p.fails) return Error{ErrorCode::kIo, store_.path() + ": the virtual disk fails this read"};
        if (p.request.mesh || disk_.corruptShare == 0) return std::nullopt;
        if (Dice(disk_.seed, p.request.record, 2)() >= disk_.corruptShare) return std::nullopt;
        return Error{ErrorCode::kBadData, store_.path() + ": the virtual disk has this chunk corrupt"};
    }

    const WorldStore& store_;
    DiskModel disk_;
    std::vector<double> freeAt_;   ///< per channel [s]
    std::deque<Pending> pending_;  ///< by their end, then as asked for
    uint64_t asked_ = 0;
};

class LiveReads : public Reads {
public:
    explicit LiveReads(const WorldStore& store) : store_(store) {
        for (int i = 0; i < kReaders; ++i)
            threads_.emplace_back([this, i](const std::stop_token& stop) { work(stop, i); });
    }
    ~LiveReads() override {
        for (std::jthread& thread : threads_) thread.request_stop();
    }

    void ask(ReadRequest request, double) override {
        {
            const std::lock_guard lock(mutex_);
            asked_.push_back(std::move(request));
        }
        ++underWay_;
        wake_.notify_one();
    }

    void collect(double, std::vector<FinishedRead>& finished) override {
        const std::lock_guard lock(mutex_);
        underWay_ -= finished_.size();
        for (FinishedRead& done : finished_) finished.push_back(std::move(done));
        finished_.clear();
    }

    size_t underWay() const override { return underWay_; }

private:
    void work(const std::stop_token& stop, int thread) {
        std::unique_lock lock(mutex_);
        while (wake_.wait(lock, stop, [this] { return !asked_.empty(); }) && !stop.stop_requested()) {
            ReadRequest request = std::move(asked_.front());
            asked_.pop_front();
            lock.unlock();
            FinishedRead done = perform(store_, std::move(request), thread);
            lock.lock();
            finished_.push_back(std::move(done));
        }
    }

    const WorldStore& store_;
    std::mutex mutex_;  ///< guards the next two
    std::deque<ReadRequest> asked_;
    std::vector<FinishedRead> finished_;
    size_t underWay_ = 0;  ///< of the asking thread
    std::condition_variable_any wake_;
    std::vector<std::jthread> threads_;  ///< last: they end before what they use
};

}  // namespace

Result<Done> requireDisk(const DiskModel& disk) {
    const auto share = [](double s) { return s >= 0 && s <= 1; };
    const auto seconds = [](double s) { return s >= 0 && std::isfinite(s); };
    if (!seconds(disk.latency) || !seconds(disk.stallSeconds) || !(disk.spread >= 0 && disk.spread <= 4))
        return Error{ErrorCode::kUsage, "virtual disk: give a latency and a stall of 0 s or more, and a spread of 0 to 4"};
    if (!(disk.bandwidth > 0) || !std::isfinite(disk.bandwidth) || disk.channels < 1 || disk.channels > 1024)
        return Error{ErrorCode::kUsage, "virtual disk: give a bandwidth above 0 bytes/s and 1 to 1024 channels"};
    if (!share(disk.stallShare) || !share(disk.failShare) || !share(disk.corruptShare))
        return Error{ErrorCode::kUsage, "virtual disk: shares are numbers from 0 to 1"};
    return Done{};
}

std::unique_ptr<Reads> makeReads(Clock clock, const WorldStore& store, const DiskModel& disk) {
    switch (clock) {
        case Clock::kLockStep:
            return std::make_unique<LockStepReads>(store);
        case Clock::kVirtual:
            return std::make_unique<VirtualReads>(store, disk);
        case Clock::kLive:
            return std::make_unique<LiveReads>(store);
    }
    return nullptr;
}

}  // namespace world
