#include "tools/sweep/slurm.h"

#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <utility>

#include "tools/input_hash.h"
#include "tools/output_folder.h"

namespace tools::sweep {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// For the shell: one word, whatever is in it.
std::string quoted(const std::string& text) {
    std::string word(1, '\'');
    for (const char c : text) {
        if (c == '\'') word.append("'\\'");
        word += c;
    }
    word += '\'';
    return word;
}

/// What a program of Slurm prints; its errors come with the rest.
Result<std::string> said(const std::string& program, const std::string& arguments) {
    FILE* pipe = popen((program + " " + arguments + " 2>&1").c_str(), "r");
    if (!pipe) return Error{ErrorCode::kLimit, program + ": " + std::strerror(errno) + "; end other processes", errno};
    std::string text;
    std::array<char, 4096> buffer;
    while (const size_t read = fread(buffer.data(), 1, buffer.size(), pipe)) text.append(buffer.data(), read);
    const int status = pclose(pipe);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        return Error{ErrorCode::kNotFound, program + " is not there; run this where Slurm's commands are"};
    if (status == 0) return text;
    std::string line = text.substr(0, text.find_last_not_of('\n') + 1);
    std::replace(line.begin(), line.end(), '\n', ' ');
    return Error{ErrorCode::kIo, line.empty() ? program + " failed" : line + "; see to Slurm, and give the command again"};
}

/// Of this sweep's jobs, so that its own can be asked for.
std::string jobName(const Sweep& sweep) { return "gnomon-" + hexOf(hashText(sweep.folder.string(), 0)); }

/// The task, as a script. sbatch keeps a copy of it.
std::string script(const Sweep& sweep, size_t base) {
    std::error_code ignored;
    const std::string program = fs::read_symlink("/proc/self/exe", ignored).string();
    return "#!/bin/sh\nexec " + quoted(program) + " sweep run " + quoted(sweep.folder.string()) + " --shard $((" + std::to_string(base) +
           " + SLURM_ARRAY_TASK_ID)) --threads \"${SLURM_CPUS_PER_TASK:-1}\"\n";
}

Result<std::string> submitOne(const Sweep& sweep, const std::vector<size_t>& tasks, size_t base) {
    const std::string file = (sweep.folder / "task.sh").string();
    if (const auto done = writeText(file, script(sweep, base)); !done) return done.error();
    std::string log;
    for (const char c : (sweep.folder / "logs").string()) log.append(c == '%' ? 2 : 1, c);
    std::string options = "--parsable --requeue --open-mode=append --ntasks=1 --job-name=" + jobName(sweep) + " --output=" + quoted(log + "/slurm-%A_%a.log") +
                          " --array=" + ranges(tasks);
    if (sweep.plan.throttle > 0) options.append("%").append(std::to_string(sweep.plan.throttle));
    for (const std::string& option : sweep.plan.sbatch) options.append(" ").append(quoted(option));
    const auto answer = said("sbatch", options + " " + quoted(file));
    if (!answer) return answer.error();
    // "ID" or "ID;CLUSTER", in the last line: what comes before are warnings.
    std::istringstream lines(answer.value());
    std::string id;
    for (std::string line; std::getline(lines, line);) id = line.substr(0, line.find(';'));
    if (id.empty() || id.find_first_not_of("0123456789") != std::string::npos)
        return Error{ErrorCode::kIo, "sbatch said '" + answer.value() + "' and no job's id; see squeue whether it was taken"};
    return id;
}

/// A task that squeue lists.
struct Entry {
    std::string job;
    size_t task = 0, shard = 0;
    std::string state, reason;
    /// Slurm could not begin it, put it back, and will not try again by itself.
    bool held() const { return state == "PENDING" && (reason.starts_with("launch failed") || reason.starts_with("launch_failed")); }
};

Result<std::vector<Entry>> askEntries(const Sweep& sweep) {
    std::vector<Entry> entries;
    const std::vector<Job> jobs = sweep.jobs();
    if (jobs.empty()) return entries;
    const auto answer = said("squeue", "--noheader --array --name=" + jobName(sweep) + " --format='%F %K %T %r'");
    if (!answer) return answer.error();
    std::istringstream lines(answer.value());
    for (std::string line; std::getline(lines, line);) {
        Entry entry;
        std::istringstream words(line);
        if (!(words >> entry.job >> entry.task >> entry.state)) continue;
        std::getline(words >> std::ws, entry.reason);
        const auto job = std::find_if(jobs.begin(), jobs.end(), [&](const Job& j) { return j.id == entry.job; });
        if (job == jobs.end()) continue;
        entry.shard = job->base + entry.task;
        entries.push_back(std::move(entry));
    }
    return entries;
}

/// Takes what Slurm holds out of its queue.
Result<Done> cancelHeld(const Sweep& sweep) {
    const auto entries = askEntries(sweep);
    if (!entries) return entries.error();
    std::string tasks;
    for (const Entry& entry : entries.value())
        if (entry.held()) tasks.append(" ").append(entry.job).append("_").append(std::to_string(entry.task));
    if (tasks.empty()) return Done{};
    if (const auto cancelled = said("scancel", tasks); !cancelled) return cancelled.error();
    return Done{};
}

}  // namespace

std::string ranges(const std::vector<size_t>& numbers) {
    std::string text;
    for (size_t k = 0, next; k < numbers.size(); k = next) {
        for (next = k + 1; next < numbers.size() && numbers[next] == numbers[next - 1] + 1;) ++next;
        if (!text.empty()) text += ',';
        text += std::to_string(numbers[k]);
        if (next > k + 1) text.append("-").append(std::to_string(numbers[next - 1]));
    }
    return text;
}

Result<std::vector<std::string>> submit(const Sweep& sweep, const std::vector<size_t>& shards) {
    if (const auto cancelled = cancelHeld(sweep); !cancelled) return cancelled.error();
    std::vector<std::string> ids;
    for (size_t k = 0; k < shards.size();) {
        const size_t base = shards[k] / kArray * kArray;
        std::vector<size_t> tasks;
        for (; k < shards.size() && shards[k] < base + kArray; ++k) tasks.push_back(shards[k] - base);
        const auto id = submitOne(sweep, tasks, base);
        if (!id) return id.error();
        if (const auto done = sweep.addJob({id.value(), base}); !done) return done.error();
        ids.push_back(id.value());
    }
    return ids;
}

Result<Queue> askQueue(const Sweep& sweep) {
    const auto entries = askEntries(sweep);
    if (!entries) return entries.error();
    Queue queue;
    for (const Entry& entry : entries.value()) {
        if (entry.held()) continue;
        const bool waits = entry.state == "PENDING" || entry.state == "CONFIGURING" || entry.state.starts_with("REQUEUE");
        queue[entry.shard] = waits ? State::kQueued : State::kRunning;
    }
    return queue;
}

}  // namespace tools::sweep
