#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "hardware_interface/handle.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/logging.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace controller_interface
{
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration
{
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names = {};
};

struct Parameter
{
  std::variant<std::string, double, std::vector<std::string>, std::vector<double>> value;
  std::string as_string() const { return std::get<0>(value); }
  double as_double() const { return std::get<1>(value); }
  std::vector<std::string> as_string_array() const { return std::get<2>(value); }
  std::vector<double> as_double_array() const { return std::get<3>(value); }
};

struct Node
{
  std::map<std::string, Parameter> parameters;
  const char * get_name() const { return "learned_feedforward"; }
  rclcpp::Logger get_logger() const { return {}; }
  Parameter get_parameter(const std::string & name) const { return parameters.at(name); }
};

class ControllerInterfaceBase
{
public:
  virtual ~ControllerInterfaceBase() = default;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }

  void assign_interfaces(
    std::vector<hardware_interface::Loaned> && commands, std::vector<hardware_interface::Loaned> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }
  std::shared_ptr<Node> get_node() { return node_; }
  std::shared_ptr<const Node> get_node() const { return node_; }

protected:
  template <typename T>
  auto auto_declare(const std::string & name, const T & fallback)
  {
    return std::get<T>(node_->parameters.emplace(name, Parameter{fallback}).first->second.value);
  }

  std::vector<hardware_interface::Loaned> command_interfaces_;
  std::vector<hardware_interface::Loaned> state_interfaces_;

private:
  std::shared_ptr<Node> node_ = std::make_shared<Node>();
};

class ChainableControllerInterface : public ControllerInterfaceBase
{
public:
  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period)
  {
    if (!chained && update_reference_from_subscribers(time, period) != return_type::OK) {
      return return_type::ERROR;
    }
    return update_and_write_commands(time, period);
  }
  std::vector<hardware_interface::CommandInterface::SharedPtr> export_reference_interfaces()
  {
    ordered_exported_reference_interfaces_ = on_export_reference_interfaces_list();
    for (const auto & own : ordered_exported_reference_interfaces_) {
      if (own->get_prefix_name().find(get_node()->get_name()) != 0) {
        throw std::runtime_error(own->get_name());
      }
    }
    return ordered_exported_reference_interfaces_;
  }

  bool chained = true;

protected:
  virtual std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list() = 0;
  virtual return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  std::vector<hardware_interface::CommandInterface::SharedPtr> ordered_exported_reference_interfaces_;
};
}  // namespace controller_interface
