#pragma once
#include <cstdio>
namespace rclcpp
{
struct Logger
{
};
}  // namespace rclcpp
#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__))
#define RCLCPP_WARN(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__))
