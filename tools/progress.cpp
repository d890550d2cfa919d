#include "tools/progress.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <ostream>
#include <utility>

namespace tools {
namespace {

constexpr int kBarWidth = 20;  // characters: label, bar, numbers and times fit 80 columns

/// "45 s", "12 min", "2.5 h".
std::string duration(double seconds) {
    char text[32];
    if (seconds < 99.5)
        std::snprintf(text, sizeof text, "%.0f s", seconds);
    else if (seconds < 99.5 * 60)
        std::snprintf(text, sizeof text, "%.0f min", seconds / 60);
    else
        std::snprintf(text, sizeof text, "%.1f h", seconds / 3600);
    return text;
}

}  // namespace

double steadySeconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Progress::Progress(std::string label, std::ostream& out, bool terminal, Seconds clock)
    : label_(std::move(label)), out_(out), terminal_(terminal), clock_(std::move(clock)) {}

Progress::~Progress() { clear(); }

void Progress::at(size_t done, size_t total) {
    if (!terminal_) return;
    const double now = clock_();
    if (!first_) first_ = Mark{now, done};
    const int percent = total == 0 ? 100 : static_cast<int>(done * 100 / total);
    if (percent == shown_ && now < shownAt_ + 1) return;
    shown_ = percent;
    shownAt_ = now;
    std::string text = std::to_string(percent) + " %, " + std::to_string(done) + " of " + std::to_string(total);
    if (done > first_->done && now > first_->seconds) {
        const double rate = double(done - first_->done) / (now - first_->seconds);
        char each[32];
        std::snprintf(each, sizeof each, ", %.3g/s", rate);
        text += each;
        if (done < total) text += ", " + duration(double(total - done) / rate) + " left";
    }
    clear();
    const size_t filled = static_cast<size_t>(kBarWidth * percent / 100);
    bar_ = label_ + " [" + std::string(filled, '#') + std::string(kBarWidth - filled, '.') + "] " + text;
    out_ << bar_ << std::flush;
}

void Progress::say(const std::string& line) {
    const std::string bar = bar_;
    clear();
    out_ << line << '\n';
    bar_ = bar;
    out_ << bar_ << std::flush;
}

void Progress::clear() {
    if (bar_.empty()) return;
    out_ << '\r' << std::string(bar_.size(), ' ') << '\r' << std::flush;
    bar_.clear();
}

bool stderrIsTerminal() { return isatty(STDERR_FILENO) == 1; }

}  // namespace tools
