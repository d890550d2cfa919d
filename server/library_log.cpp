#include "server/library_log.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>

#include <atomic>

namespace server {
namespace {

std::atomic<void (*)(const std::string&)> taker = nullptr;  // gRPC takes a function and nothing with it

}  // namespace

void listenToLibraries(void (*take)(const std::string&)) {
    taker = take;
    google::protobuf::SetLogHandler(nullptr);
    gpr_set_log_function([](gpr_log_func_args* said) {
        if (said->severity == GPR_LOG_SEVERITY_ERROR) taker.load()(said->message);
    });
}

}  // namespace server
