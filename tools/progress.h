// tools/progress.h — how far a long command has come: a bar on a terminal, else a line every tenth.
#pragma once

#include <cstddef>
#include <iosfwd>
#include <string>

namespace tools {

/// One thread at a time. Writes little: the bar changes with each percent, lines come at 10 %, 20 % ...
class Progress {
public:
    /// `label` names the work; `out` must outlive the object; `terminal`: `out` can move its cursor.
    Progress(std::string label, std::ostream& out, bool terminal);
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress();  ///< removes the bar

    /// `done` of `total` things are done; done <= total. Nothing of nothing is 100 %.
    void at(size_t done, size_t total);
    /// Prints a line that stays, above the bar.
    void say(const std::string& line);

private:
    void clear();

    std::string label_;
    std::ostream& out_;
    bool terminal_;
    int shown_ = -1;   ///< last percentage printed
    std::string bar_;  ///< what stands on the terminal's last line now
};

/// Whether stderr is a terminal.
bool stderrIsTerminal();

}  // namespace tools
