#include "tools/progress.h"

#include <unistd.h>

#include <ostream>
#include <utility>

namespace tools {
namespace {

constexpr int kBarWidth = 40;  // characters: label, bar and numbers fit 80 columns

}  // namespace

Progress::Progress(std::string label, std::ostream& out, bool terminal)
    : label_(std::move(label)), out_(out), terminal_(terminal) {}

Progress::~Progress() { clear(); }

void Progress::at(size_t done, size_t total) {
    const int percent = total == 0 ? 100 : static_cast<int>(done * 100 / total);
    const int step = terminal_ ? percent : percent / 10 * 10;
    if (step == shown_) return;
    shown_ = step;
    const std::string counts = std::to_string(done) + " of " + std::to_string(total);
    if (terminal_) {
        clear();
        const size_t filled = static_cast<size_t>(kBarWidth * percent / 100);
        bar_ =
            label_ + " [" + std::string(filled, '#') + std::string(kBarWidth - filled, '.') + "] " + counts;
        out_ << bar_ << std::flush;
    } else if (step > 0) {
        out_ << label_ << ": " << step << " %, " << counts << '\n' << std::flush;
    }
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
