// world/result.h — a value, or an error that a caller is expected to meet (bad file, request, device).
#pragma once

#include <string>
#include <utility>
#include <variant>

#include "world/check.h"

namespace world {

enum class ErrorCode {
    kUsage,     ///< the caller asked for something that makes no sense; exit status 2
    kNotFound,  ///< a file, row or device is missing
    kBadData,   ///< a file or chunk is truncated, corrupt, foreign or out of range; exit status 3
    kIo,        ///< reading or writing failed (disk full, permission)
    kDevice,    ///< Vulkan or Embree refused
    kLimit,     ///< a budget or quota would be exceeded
};

struct Error {
    ErrorCode code = ErrorCode::kBadData;
    std::string what;  ///< one line: names the object, the place in it and the remedy
    int native = 0;    ///< VkResult, RTCError, SQLite code or errno behind it; 0 if none
};

/// Either a T or an Error; asking for the one it does not hold is a broken invariant.
template <class T>
class [[nodiscard]] Result {
public:
    Result(T value) : v_(std::in_place_index<0>, std::move(value)) {}
    Result(Error error) : v_(std::in_place_index<1>, std::move(error)) {}
    explicit operator bool() const { return v_.index() == 0; }
    T& value() {
        CHECK(*this);
        return *std::get_if<0>(&v_);
    }
    const T& value() const {
        CHECK(*this);
        return *std::get_if<0>(&v_);
    }
    const Error& error() const {
        CHECK(!*this);
        return *std::get_if<1>(&v_);
    }

private:
    std::variant<T, Error> v_;
};

/// The value of a Result whose success carries nothing.
struct Done {};

}  // namespace world
