// Written by a program; README.md says how to use it.
#ifndef @GUARD@
#define @GUARD@

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "@NAME@.h"
#include "controller_interface/chainable_controller_interface.hpp"
#include "hardware_interface/handle.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace @PACKAGE@
{
/// Efforts that the motion asked for takes, as learned; perhaps a PD beside them.
class Feedforward : public controller_interface::ChainableControllerInterface
{
public:
  static constexpr std::size_t JOINTS = @UPPER@_COMMANDS;
  /// Position, velocity, acceleration, and an effort that is added.
  static constexpr std::size_t ORDERS = 4;

  controller_interface::CallbackReturn on_init() override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;

protected:
  std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list() override;
  controller_interface::return_type update_reference_from_subscribers(
    const rclcpp::Time & time, const rclcpp::Duration & period) override;
  controller_interface::return_type update_and_write_commands(
    const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  using PerJoint = std::array<double, JOINTS>;

  bool gains_of(const std::string & name, PerJoint & gains);
  bool read_references();
  void ask_model();
  double fed_back(std::size_t joint);
  double added(std::size_t joint) const;

  std::vector<std::string> joints_;
  std::string interface_;
  PerJoint p_{}, d_{};
  bool feeds_back_ = false;
  double fade_time_ = 0.0;

  @NAME@_state state_{};
  std::array<double, JOINTS * (ORDERS - 1)> asked_{};
  std::array<double, 2 * JOINTS> measured_{};
  PerJoint learned_{};
  bool answered_ = false;
  double active_ = 0.0;   // part of all, [0, 1]: 0 while there is no reference
  double trusted_ = 0.0;  // part of what was learned, [0, 1]: 0 while the model has no answer
};
}  // namespace @PACKAGE@

#endif
