#include "tools/sweep/folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "tools/input_hash.h"
#include "tools/output_folder.h"
#include "world/program.h"

namespace tools::sweep {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr int kVersion = 1;
constexpr const char* kPartial = ".partial.";  ///< KEY.partial.XXXXXX

Error io(const fs::path& path, int code) {
    return {ErrorCode::kIo, path.string() + ": " + std::strerror(code) + "; a sweep needs a folder that can be written, with room", code};
}

/// A descriptor that closes itself.
struct Descriptor {
    int fd;
    explicit Descriptor(const fs::path& path, int flags) : fd(open(path.c_str(), flags | O_CLOEXEC, 0644)) {}
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor() {
        if (fd >= 0) close(fd);
    }
};

Result<Done> synced(const fs::path& path) {
    const Descriptor file(path, O_RDONLY);
    if (file.fd < 0 || fsync(file.fd) != 0) return io(path, errno);
    return Done{};
}

/// Whether the process that made this folder is alive, on whatever machine.
bool isHeld(const fs::path& partial) {
    const Descriptor lock(partial / "lock", O_RDWR);
    return lock.fd >= 0 && flock(lock.fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

/// Of the results of a shard's Nth run, from 1.
std::string resultsName(const std::string& key, int run) {
    std::string name = key;
    if (run > 1) name.append(".").append(std::to_string(run));
    return name + ".sqlite";
}

/// Names in shards/, sorted.
Result<std::set<std::string>> shardNames(const fs::path& folder) {
    std::set<std::string> names;
    std::error_code error;
    for (fs::directory_iterator entry(folder / "shards", error), end; !error && entry != end; entry.increment(error))
        names.insert(entry->path().filename().string());
    if (error) return io(folder / "shards", error.value());
    return names;
}

Json toJson(const Sweep& sweep) {
    Json shards = Json::array();
    for (const Shard& s : sweep.plan.shards)
        shards.push_back({{"key", s.key}, {"label", s.label}, {"world", s.world}, {"path", s.path}, {"movers", s.movers},
                          {"world_hash", s.worldHash}, {"path_hash", s.pathHash}, {"movers_hash", s.moversHash}, {"options", s.options}});
    return {{"gnomon_sweep", kVersion}, {"program", sweep.program}, {"slurm", sweep.slurm}, {"sbatch", sweep.plan.sbatch},
            {"throttle", sweep.plan.throttle}, {"shards", shards}};
}

Sweep fromJson(const fs::path& folder, const Json& json) {
    Sweep sweep{.folder = folder, .program = json.at("program"), .slurm = json.at("slurm"), .plan = {}};
    sweep.plan.sbatch = json.at("sbatch").get<std::vector<std::string>>();
    sweep.plan.throttle = json.at("throttle");
    for (const Json& s : json.at("shards"))
        sweep.plan.shards.push_back({s.at("key"), s.at("label"), s.at("world"), s.at("path"), s.at("movers"), s.at("world_hash"), s.at("path_hash"),
                                     s.at("movers_hash"), s.at("options").get<std::vector<std::string>>()});
    return sweep;
}

}  // namespace

const char* toString(State state) {
    switch (state) {
        case State::kDone: return "done";
        case State::kRunning: return "running";
        case State::kQueued: return "queued";
        case State::kFailed: return "failed";
        case State::kLost: break;
    }
    return "lost";
}

Result<Done> Sweep::requireProgram() const {
    if (program == hexOf(world::hashProgram())) return Done{};
    return Error{ErrorCode::kUsage, folder.string() + ": was made by another build of gnomon, whose results may differ; use that one, or make the sweep in another folder"};
}

bool Sweep::done(const Shard& shard) const {
    std::error_code ignored;
    return fs::exists(results(shard), ignored);
}

std::vector<fs::path> Sweep::allResults(const Shard& shard) const {
    std::vector<fs::path> files;
    std::error_code ignored;
    for (int run = 1;; ++run) {
        fs::path file = folder / "shards" / resultsName(shard.key, run);
        if (!fs::exists(file, ignored)) return files;
        files.push_back(std::move(file));
    }
}

Result<std::vector<Status>> Sweep::status(const Queue& queue) const {
    const auto names = shardNames(folder);
    if (!names) return names.error();
    std::vector<Status> all;
    for (size_t k = 0; k < plan.shards.size(); ++k) {
        const Shard& shard = plan.shards[k];
        Status& status = all.emplace_back();
        if (names.value().contains(shard.key + ".sqlite")) {
            status.state = State::kDone;
            continue;
        }
        const std::string partial = shard.key + kPartial;
        for (auto name = names.value().lower_bound(partial); name != names.value().end() && name->starts_with(partial); ++name)
            if (isHeld(folder / "shards" / *name)) status.state = State::kRunning;
        if (status.state == State::kRunning) continue;
        if (const auto at = queue.find(k); at != queue.end()) {
            status.state = at->second;
        } else if (names.value().contains(shard.key + ".failed")) {
            status.state = State::kFailed;
            std::ifstream why(failure(shard));
            std::getline(why, status.why);
        } else if (done(shard)) {
            status.state = State::kDone;  // since the names were read
        }
    }
    return all;
}

Result<Done> Sweep::addJob(const Job& job) const {
    const Descriptor file(folder / "jobs", O_WRONLY | O_CREAT | O_APPEND);
    const std::string line = job.id + " " + std::to_string(job.base) + "\n";
    if (file.fd < 0 || write(file.fd, line.data(), line.size()) != ssize_t(line.size()) || fsync(file.fd) != 0) return io(folder / "jobs", errno);
    return Done{};
}

std::vector<Job> Sweep::jobs() const {
    std::vector<Job> jobs;
    std::ifstream file(folder / "jobs");
    for (Job job; file >> job.id >> job.base;) jobs.push_back(job);
    return jobs;
}

void Sweep::tidy() const {
    const auto names = shardNames(folder);
    if (!names) return;
    std::error_code ignored;
    for (const std::string& name : names.value())
        if (name.find(kPartial) != std::string::npos && !isHeld(folder / "shards" / name)) fs::remove_all(folder / "shards" / name, ignored);
}

Result<Sweep> makeSweep(const std::string& folder, Plan plan, bool slurm) {
    std::error_code error;
    Sweep sweep{fs::absolute(folder).lexically_normal(), hexOf(world::hashProgram()), slurm, std::move(plan)};
    if (!sweep.folder.has_filename()) sweep.folder = sweep.folder.parent_path();
    if (fs::exists(sweep.folder / "sweep.json", error)) {
        const auto there = openSweep(folder);
        if (!there) return there.error();
        const auto sameKey = [](const Shard& a, const Shard& b) { return a.key == b.key; };
        if (!std::equal(there.value().plan.shards.begin(), there.value().plan.shards.end(), sweep.plan.shards.begin(), sweep.plan.shards.end(), sameKey))
            return Error{ErrorCode::kUsage, folder + ": holds a sweep of other shards; give another folder, or the plan that it was made of"};
        if (const auto ours = there.value().requireProgram(); !ours) return ours.error();
    } else if (fs::exists(sweep.folder, error) && (!fs::is_directory(sweep.folder, error) || !fs::is_empty(sweep.folder, error))) {
        return Error{ErrorCode::kUsage, folder + ": holds something else; give a sweep a folder of its own"};
    }
    fs::create_directories(sweep.folder, error);
    if (error) return io(sweep.folder, error.value());
    if (const auto done = writeText((sweep.folder / "sweep.json").string(), toJson(sweep).dump(1) + "\n"); !done) return done.error();
    for (const char* name : {"shards", "logs"}) {
        fs::create_directories(sweep.folder / name, error);
        if (error) return io(sweep.folder / name, error.value());
    }
    return sweep;
}

Result<Sweep> openSweep(const std::string& folder) {
    const fs::path absolute = fs::absolute(folder).lexically_normal(), file = absolute / "sweep.json";
    std::ifstream in(file);
    if (!in) return Error{ErrorCode::kNotFound, folder + ": holds no sweep; gnomon sweep PLAN.toml -o " + folder + " makes one"};
    // Only nlohmann's parser without exceptions is silent; what is taken from the result may still be of another kind.
    try {
        const Json json = Json::parse(in);
        if (json.at("gnomon_sweep") != kVersion)
            return Error{ErrorCode::kBadData, file.string() + ": was written by another version of gnomon; use that one, or make the sweep anew"};
        return fromJson(absolute.has_filename() ? absolute : absolute.parent_path(), json);
    } catch (const Json::exception& error) {
        return Error{ErrorCode::kBadData, file.string() + ": is damaged; give the same gnomon sweep again in an empty folder"};
    }
}

Result<Attempt> Attempt::begin(const Sweep& sweep, const Shard& shard) {
    auto partial = std::make_unique<Partial>();
    partial->shards = sweep.folder / "shards";
    partial->key = shard.key;
    std::string name = (partial->shards / (shard.key + kPartial)).string() + "XXXXXX";
    if (!mkdtemp(name.data())) return io(partial->shards, errno);
    partial->folder = name;
    partial->lock = open((partial->folder / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (partial->lock < 0 || flock(partial->lock, LOCK_EX) != 0) return io(partial->folder, errno);
    return Attempt(std::move(partial));
}

Attempt::Partial::~Partial() {
    std::error_code ignored;  // `tidy` comes again
    if (!folder.empty()) fs::remove_all(folder, ignored);
    if (lock >= 0) close(lock);
}

Result<Done> Attempt::publish() const {
    if (const auto done = synced(results()); !done) return done;
    // A link, not a rename, which would put an earlier attempt's results out of the world.
    for (int run = 1;; ++run) {
        const fs::path name = partial_->shards / resultsName(partial_->key, run);
        if (link(results().c_str(), name.c_str()) == 0) break;
        if (errno != EEXIST) return io(name, errno);
    }
    return synced(partial_->shards);
}

}  // namespace tools::sweep
