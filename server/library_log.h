// server/library_log.h — what gRPC and protobuf have to say, where the rest of the log goes.
#pragma once

#include <string>

namespace server {

/// For the process. Errors of gRPC come as lines, from any thread; requests that are none, which protobuf would complain of,
/// are told to who sent them and to nobody else.
void listenToLibraries(void (*take)(const std::string& line));

}  // namespace server
