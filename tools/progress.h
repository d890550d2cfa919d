// tools/progress.h — how far a long command has come: a bar on a terminal, else nothing.
#pragma once

#include <cstddef>
#include <functional>
#include <iosfwd>
#include <optional>
#include <string>

namespace tools {

/// Seconds on a clock that only goes forward, from any moment on.
using Seconds = std::function<double()>;
double steadySeconds();

/// One thread at a time. Writes little: the bar changes with each percent, and each second if more is done.
class Progress {
public:
    /// `label` names the work; `out` must outlive the object; `terminal`: `out` can move its cursor, else
    /// it gets no bar.
    Progress(std::string label, std::ostream& out, bool terminal, Seconds clock = steadySeconds);
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress();  ///< removes the bar

    /// `done` of `total` things are done; done <= total. Nothing of nothing is 100 %. What was done by the
    /// first call does not count for the rate, as it may have been done long ago.
    void at(size_t done, size_t total);
    /// Prints a line that stays, above the bar.
    void say(const std::string& line);

private:
    /// A moment and what was done then.
    struct Mark {
        double seconds;
        size_t done;
    };
    void clear();

    std::string label_;
    std::ostream& out_;
    bool terminal_;
    Seconds clock_;
    std::optional<Mark> first_;  ///< call
    int shown_ = -1;             ///< last percentage printed
    double shownAt_ = 0;         ///< [s], of the clock
    std::string bar_;            ///< what stands on the terminal's last line now
};

/// Whether stderr is a terminal.
bool stderrIsTerminal();

}  // namespace tools
