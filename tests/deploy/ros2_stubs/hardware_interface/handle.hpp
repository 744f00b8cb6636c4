#pragma once
#include <memory>
#include <optional>
#include <string>

namespace hardware_interface
{
class CommandInterface
{
public:
  using SharedPtr = std::shared_ptr<CommandInterface>;
  CommandInterface(const std::string & prefix, const std::string & name) : prefix_(prefix), name_(prefix + "/" + name)
  {
  }
  const std::string & get_name() const { return name_; }
  const std::string & get_prefix_name() const { return prefix_; }
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional() const
  {
    return locked ? std::nullopt : std::optional<T>(value);
  }
  template <typename T>
  [[nodiscard]] bool set_value(const T & given)
  {
    value = locked ? value : given;
    return !locked;
  }

  double value = 0.0;
  bool locked = false;  // by another thread

private:
  std::string prefix_, name_;
};
using StateInterface = CommandInterface;

/// Of commands and of states, which a controller only reads.
class Loaned
{
public:
  explicit Loaned(CommandInterface::SharedPtr own) : own_(own) {}
  const std::string & get_name() const { return own_->get_name(); }
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional() const
  {
    return own_->get_optional<T>();
  }
  template <typename T>
  [[nodiscard]] bool set_value(const T & given)
  {
    return own_->set_value(given);
  }

private:
  CommandInterface::SharedPtr own_;
};
}  // namespace hardware_interface
