#pragma once
#include <type_traits>
#define PLUGINLIB_EXPORT_CLASS(own, base) \
  static_assert(std::is_base_of<base, own>::value && std::is_default_constructible<own>::value, "no plugin");
