#include "server/session_stream.h"

#include <utility>

#include "world/check.h"

namespace server {

namespace v1 = gnomon::v1;
using Clock = std::chrono::steady_clock;

SessionStream::SessionStream(grpc::CallbackServerContext* context, const StreamLimits& limits)
    : context_(context), limits_(limits) {}

void SessionStream::start(std::function<grpc::Status(SessionStream&)> work, std::function<void()> gone) {
    gone_ = std::move(gone);
    {
        const std::lock_guard lock(mutex_);
        reading_ = true;
        waits_.asking = Clock::now();
    }
    thread_ = std::thread([this, run = std::move(work)] {
        const grpc::Status status = run(*this);
        Finish(status);
    });
    StartRead(&incoming_);
}

void SessionStream::join() { thread_.join(); }

std::deque<v1::SessionRequest> SessionStream::next(bool all) {
    std::deque<v1::SessionRequest> taken;
    std::unique_lock lock(mutex_);
    if (waiting_.empty()) waits_.asking = Clock::now();
    changed_.wait(lock, [this] { return !waiting_.empty() || ended_ || verdict_; });
    waits_.asking.reset();
    if (verdict_) return taken;
    do {
        if (waiting_.empty()) break;
        bytes_ -= waiting_.front().ByteSizeLong();
        taken.push_back(std::move(waiting_.front()));
        waiting_.pop_front();
    } while (all);
    const bool more = !reading_ && !ended_ && room();
    reading_ |= more;
    lock.unlock();
    if (more) StartRead(&incoming_);
    return taken;
}

bool SessionStream::write(const v1::SessionReply& reply) {
    {
        const std::lock_guard lock(mutex_);
        written_ = false;
        waits_.writing = Clock::now();
    }
    StartWrite(&reply);
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return written_; });
    waits_.writing.reset();
    return writeOk_;
}

grpc::Status SessionStream::verdict() const {
    const std::lock_guard lock(mutex_);
    return verdict_.value_or(grpc::Status::OK);
}

void SessionStream::end(const grpc::Status& why) {
    const std::lock_guard lock(mutex_);
    if (!verdict_) verdict_ = why;
    changed_.notify_all();
}

void SessionStream::cancel() {
    const std::lock_guard lock(contextMutex_);
    if (context_) context_->TryCancel();
}

SessionStream::Wait SessionStream::waits() const {
    const std::lock_guard lock(mutex_);
    return waits_;
}

void SessionStream::OnReadDone(bool ok) {
    std::unique_lock lock(mutex_);
    reading_ = false;
    if (ok) {
        bytes_ += incoming_.ByteSizeLong();
        waiting_.push_back(std::move(incoming_));
        incoming_.Clear();
        reading_ = room() && !verdict_;
    } else {
        ended_ = true;
    }
    const bool more = reading_;
    lock.unlock();
    changed_.notify_all();
    if (more) StartRead(&incoming_);
}

void SessionStream::OnWriteDone(bool ok) {
    {
        const std::lock_guard lock(mutex_);
        written_ = true;
        writeOk_ = ok;
    }
    changed_.notify_all();
}

void SessionStream::OnCancel() {
    const std::lock_guard lock(mutex_);
    if (!verdict_) verdict_ = grpc::Status(grpc::StatusCode::CANCELLED, "the client is gone");
    changed_.notify_all();
}

void SessionStream::OnDone() {
    {
        const std::lock_guard lock(contextMutex_);
        context_ = nullptr;
    }
    const auto gone = std::move(gone_);
    gone();
}

}  // namespace server
