// world/gltf_file.cpp — a first pass over the JSON finds what must not reach the library: nesting deep
// enough to overflow its recursion, and URIs that leave the folder.

#include "world/gltf_file.h"

#include <tiny_gltf.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

namespace world {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Bytes = std::vector<unsigned char>;

constexpr int kDeepest = 128;  // the library recurses into extras; a level costs it about 1 KiB of stack
constexpr uint64_t kMostBytes = 0xffffffffu;  // lengths in a GLB and in the library have 32 bits

Error bad(std::string what) { return {ErrorCode::kBadData, std::move(what)}; }

Result<Bytes> readWhole(const fs::path& path) {
    std::error_code failed;
    const fs::file_status status = fs::status(path, failed);
    if (status.type() == fs::file_type::not_found)
        return Error{ErrorCode::kNotFound, path.string() + ": no such file; check the name"};
    if (!fs::is_regular_file(status)) return bad(path.string() + ": not a regular file");
    const uint64_t size = fs::file_size(path, failed);
    if (failed) return Error{ErrorCode::kIo, path.string() + ": " + failed.message(), failed.value()};
    if (size > kMostBytes)
        return Error{ErrorCode::kLimit, path.string() + ": larger than 4 GiB; split it into several files"};
    Bytes bytes(size);
    std::ifstream in(path, std::ios::binary);
    if (!in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size)))
        return Error{ErrorCode::kIo, path.string() + ": cannot be read; check its permissions"};
    return bytes;
}

uint32_t wordAt(const Bytes& bytes, size_t offset) {
    const auto at = [&](size_t i) { return static_cast<uint32_t>(bytes[offset + i]) << (8 * i); };
    return at(0) | at(1) | at(2) | at(3);
}

bool isGlb(const Bytes& bytes) { return bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0; }

/// The JSON text of a GLB whose chunk lengths fit the file. The library forgets the header of the
/// binary chunk when it compares lengths, and would read up to 8 bytes past the end.
Result<std::string_view> jsonOfGlb(const Bytes& bytes) {
    const auto cut = [](const char* part) {
        return bad(std::string("truncated in ") + part + "; copy or export the file again");
    };
    if (bytes.size() < 20) return cut("its header");
    const uint64_t size = bytes.size(), length = wordAt(bytes, 8), json = wordAt(bytes, 12);
    if (length > size) return cut("the body that its header declares");
    if (20 + json > length) return cut("its JSON chunk");
    if (20 + json < length) {
        if (28 + json > length) return cut("the header of its binary chunk");
        if (28 + json + wordAt(bytes, 20 + json) > length) return cut("its binary chunk");
    }
    return std::string_view(reinterpret_cast<const char*>(bytes.data()) + 20, json);
}

int hexDigit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

std::optional<std::string> percentDecoded(const std::string& uri) {
    std::string out;
    for (size_t i = 0; i < uri.size(); ++i) {
        if (uri[i] != '%') {
            out += uri[i];
            continue;
        }
        if (i + 2 >= uri.size()) return std::nullopt;
        const int high = hexDigit(uri[i + 1]), low = hexDigit(uri[i + 2]);
        if (high < 0 || low < 0) return std::nullopt;
        out += static_cast<char>(high * 16 + low);
        i += 2;
    }
    return out;
}

bool isInside(const fs::path& file, const fs::path& folder) {
    return std::mismatch(folder.begin(), folder.end(), file.begin(), file.end()).first == folder.end();
}

/// The file that a buffer's relative URI names. Nothing outside `folder` is opened, or told to exist.
Result<fs::path> resolve(const std::string& uri, const fs::path& folder) {
    const auto refuse = [&](const char* why) { return bad("buffer URI '" + uri + "' " + why); };
    if (uri.find(':') < uri.find('/')) return refuse("has a scheme; only data: and relative paths are read");
    const std::optional<std::string> decoded = percentDecoded(uri);
    if (!decoded || decoded->find('\0') != std::string::npos)
        return refuse("is not percent-encoded correctly");
    const fs::path relative = fs::path(*decoded).lexically_normal();
    if (relative.is_absolute() || relative.empty() || *relative.begin() == "..")
        return refuse("leaves the file's folder; put the buffer beside the file");
    std::error_code failed;
    const fs::path home = fs::canonical(folder, failed);
    if (failed) return Error{ErrorCode::kIo, folder.string() + ": " + failed.message(), failed.value()};
    const fs::path file = fs::canonical(home / relative, failed);
    if (failed) return Error{ErrorCode::kNotFound, "buffer URI '" + uri + "': no such file beside it"};
    if (!isInside(file, home)) return refuse("is a link out of the file's folder; put the buffer beside it");
    return file;
}

/// The external files of all buffers, in order, from the JSON text.
Result<std::vector<fs::path>> bufferFiles(std::string_view text, bool glb, const fs::path& folder) {
    bool tooDeep = false;
    const auto keep = [&](int depth, Json::parse_event_t event, Json& parsed) {
        if (depth > kDeepest) tooDeep = true;
        return !tooDeep && (depth != 1 || event != Json::parse_event_t::key || parsed == "buffers");
    };
    Json root;
    try {
        root = Json::parse(text, keep);
    } catch (const std::exception& e) {
        return bad(std::string("not valid JSON: ") + e.what());
    }
    if (tooDeep) return bad("JSON nested deeper than " + std::to_string(kDeepest) + " levels");
    std::vector<fs::path> files;
    if (!root.is_object() || !root.contains("buffers")) return files;
    size_t index = 0;
    for (const Json& buffer : root["buffers"]) {
        const std::string name = "buffer " + std::to_string(index);
        const auto member = [&](const char* key) {
            return buffer.is_object() ? buffer.value(key, Json()) : Json();
        };
        const Json length = member("byteLength"), uri = member("uri");
        if (!length.is_number_unsigned() || length == 0)
            return bad(name + ": byteLength must be a whole number above zero");
        const bool named = uri.is_string() && !uri.get_ref<const std::string&>().empty();
        if (!named && !(glb && index == 0))
            return bad(name + " has no URI, and is not the binary chunk of a .glb");
        if (named) {
            const std::string& at = uri.get_ref<const std::string&>();
            if (at.starts_with("data:")) {
                if (!tinygltf::IsDataURI(at))
                    return bad(name + ": its data: URI is not base64 of a known type");
            } else {
                Result<fs::path> file = resolve(at, folder);
                if (!file) return file.error();
                files.push_back(std::move(file.value()));
            }
        }
        ++index;
    }
    return files;
}

/// The library asks for each external buffer in order, then for the images, which find nothing.
struct BufferQueue {
    std::vector<fs::path> files;
    size_t next = 0;
};

tinygltf::FsCallbacks callbacksFor(BufferQueue& queue) {
    tinygltf::FsCallbacks calls{};
    calls.user_data = &queue;
    calls.ExpandFilePath = [](const std::string& path, void*) { return path; };
    calls.FileExists = [](const std::string&, void* user) {
        const auto* buffers = static_cast<const BufferQueue*>(user);
        return buffers->next < buffers->files.size();
    };
    calls.ReadWholeFile = [](Bytes* out, std::string* error, const std::string&, void* user) {
        auto* buffers = static_cast<BufferQueue*>(user);
        Result<Bytes> bytes = readWhole(buffers->files[buffers->next++]);
        if (!bytes) {
            *error = bytes.error().what;
            return false;
        }
        *out = std::move(bytes.value());
        return true;
    };
    calls.WriteWholeFile = [](std::string*, const std::string&, const Bytes&, void*) { return false; };
    return calls;
}

bool ignoreImage(tinygltf::Image*, int, std::string*, std::string*, int, int, const unsigned char*, int,
                 void*) {
    return true;
}

Result<std::shared_ptr<const tinygltf::Model>> parse(const Bytes& bytes, const fs::path& folder) {
    const bool glb = isGlb(bytes);
    std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    if (glb) {
        Result<std::string_view> json = jsonOfGlb(bytes);
        if (!json) return json.error();
        text = json.value();
    }
    Result<std::vector<fs::path>> files = bufferFiles(text, glb, folder);
    if (!files) return files.error();

    BufferQueue queue{std::move(files.value())};
    tinygltf::TinyGLTF loader;
    loader.SetImageLoader(ignoreImage, nullptr);
    loader.SetFsCallbacks(callbacksFor(queue));
    const auto model = std::make_shared<tinygltf::Model>();
    std::string error, warning;
    const auto size = static_cast<unsigned>(bytes.size());
    bool loaded = false;
    try {
        loaded = glb ? loader.LoadBinaryFromMemory(model.get(), &error, &warning, bytes.data(), size, "",
                                                   tinygltf::REQUIRE_VERSION)
                     : loader.LoadASCIIFromString(model.get(), &error, &warning, text.data(), size, "",
                                                  tinygltf::REQUIRE_VERSION);
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kLimit, "its buffers do not fit into memory"};
    } catch (const std::exception& e) {
        error = e.what();
    }
    if (!loaded) return bad(error.empty() ? "not a glTF file" : error);
    if (!model->asset.version.starts_with("2."))
        return bad("glTF version '" + model->asset.version + "'; convert it to 2.0");
    for (const std::string& extension : model->extensionsRequired) {
        if (changesGeometry(extension))
            return bad("requires the extension " + extension + ", which is not supported; export without it");
    }
    return std::shared_ptr<const tinygltf::Model>(model);
}

}  // namespace

bool changesGeometry(const std::string& extension) {
    return extension != "KHR_lights_punctual" && extension != "MSFT_texture_dds" &&
           !extension.starts_with("KHR_materials_") && !extension.starts_with("KHR_texture_") &&
           !extension.starts_with("EXT_texture_");
}

Error inFile(const std::string& path, Error error) {
    constexpr size_t kLongest = 400;
    std::string& text = error.what;
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
    for (char& c : text)
        if (static_cast<unsigned char>(c) < 0x20) c = ' ';
    if (text.size() > kLongest) text = text.substr(0, kLongest) + "...";
    text = path + ": " + text;
    return error;
}

Result<std::shared_ptr<const tinygltf::Model>> readGltfFile(const std::string& path) {
    Result<Bytes> bytes = readWhole(path);
    if (!bytes) return bytes.error();
    const fs::path folder = fs::path(path).parent_path();
    auto model = parse(bytes.value(), folder.empty() ? fs::path(".") : folder);
    if (!model) return inFile(path, model.error());
    return model;
}

}  // namespace world
