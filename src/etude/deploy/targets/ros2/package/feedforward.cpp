// Written by a program; README.md says how to use it.
#include "@PACKAGE@/feedforward.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/logging.hpp"

namespace @PACKAGE@
{
namespace
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

constexpr double NOTHING = std::numeric_limits<double>::quiet_NaN();
const char * const REFERENCES[Feedforward::ORDERS] = {"position", "velocity", "acceleration", "effort"};
const char * const NAMES[Feedforward::JOINTS] = {@JOINTS@};
// of each input of the model: which of the references it is, all positions first
constexpr std::size_t SOURCES[@UPPER@_INPUTS] = {@SOURCES@};

double moved(double part, bool up, double step)
{
  return std::min(1.0, std::max(0.0, up ? part + step : part - step));
}
}  // namespace

CallbackReturn Feedforward::on_init()
{
  try {
    auto_declare<std::vector<std::string>>("joints", std::vector<std::string>(NAMES, NAMES + JOINTS));
    auto_declare<std::string>("interface", "@INTERFACE@");
    auto_declare<std::vector<double>>("p", std::vector<double>());
    auto_declare<std::vector<double>>("d", std::vector<double>());
    auto_declare<double>("fade_time", 0.2);
  } catch (const std::exception & error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn Feedforward::on_configure(const rclcpp_lifecycle::State &)
{
  joints_ = get_node()->get_parameter("joints").as_string_array();
  interface_ = get_node()->get_parameter("interface").as_string();
  fade_time_ = get_node()->get_parameter("fade_time").as_double();
  if (joints_.size() != JOINTS) {
    RCLCPP_ERROR(get_node()->get_logger(), "'joints' must name %zu, in the order of the model", JOINTS);
    return CallbackReturn::ERROR;
  }
  if (!(fade_time_ > 0.0) || !gains_of("p", p_) || !gains_of("d", d_)) {
    RCLCPP_ERROR(
      get_node()->get_logger(), "'p' and 'd' must hold %zu numbers of at least 0, or none; 'fade_time' more than 0",
      JOINTS);
    return CallbackReturn::ERROR;
  }
  const auto positive = [](double gain) { return gain > 0.0; };
  feeds_back_ = std::any_of(p_.begin(), p_.end(), positive) || std::any_of(d_.begin(), d_.end(), positive);
  if (!feeds_back_) {
    RCLCPP_WARN(
      get_node()->get_logger(),
      "'p' and 'd' are zero: nothing here feeds back, so something else must, through the effort references");
  }
  return CallbackReturn::SUCCESS;
}

bool Feedforward::gains_of(const std::string & name, PerJoint & gains)
{
  const auto given = get_node()->get_parameter(name).as_double_array();
  gains.fill(0.0);
  if (given.empty()) {
    return true;
  }
  std::copy_n(given.begin(), std::min(given.size(), JOINTS), gains.begin());
  const auto fine = [](double gain) { return std::isfinite(gain) && gain >= 0.0; };
  return given.size() == JOINTS && std::all_of(gains.begin(), gains.end(), fine);
}

InterfaceConfiguration Feedforward::command_interface_configuration() const
{
  InterfaceConfiguration wanted{interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    wanted.names.push_back(joint + "/" + interface_);
  }
  return wanted;
}

InterfaceConfiguration Feedforward::state_interface_configuration() const
{
  InterfaceConfiguration wanted{interface_configuration_type::NONE, {}};
  if (feeds_back_) {
    wanted.type = interface_configuration_type::INDIVIDUAL;
    for (const char * order : {"position", "velocity"}) {
      for (const auto & joint : joints_) {
        wanted.names.push_back(joint + "/" + order);
      }
    }
  }
  return wanted;
}

std::vector<hardware_interface::CommandInterface::SharedPtr> Feedforward::on_export_reference_interfaces_list()
{
  std::vector<hardware_interface::CommandInterface::SharedPtr> exported;
  for (const char * order : REFERENCES) {
    for (const auto & joint : joints_) {
      exported.push_back(std::make_shared<hardware_interface::CommandInterface>(
        std::string(get_node()->get_name()) + "/" + joint, order));
    }
  }
  return exported;
}

CallbackReturn Feedforward::on_activate(const rclcpp_lifecycle::State &)
{
  @NAME@_init(&state_);
  learned_.fill(0.0);
  asked_.fill(0.0);
  measured_.fill(NOTHING);
  active_ = trusted_ = 0.0;
  answered_ = false;
  for (auto & reference : ordered_exported_reference_interfaces_) {
    static_cast<void>(reference->set_value(NOTHING));
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn Feedforward::on_deactivate(const rclcpp_lifecycle::State &)
{
  for (auto & command : command_interfaces_) {
    static_cast<void>(command.set_value(0.0));
  }
  return CallbackReturn::SUCCESS;
}

return_type Feedforward::update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &)
{
  return return_type::OK;  // references come from a controller before this one, and from no topic
}

return_type Feedforward::update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration & period)
{
  const double step = std::max(0.0, period.seconds()) / fade_time_;
  const bool complete = read_references();
  if (complete) {
    ask_model();
  }
  active_ = moved(active_, complete, step);
  trusted_ = moved(trusted_, answered_, step);
  for (std::size_t j = 0; j < JOINTS; ++j) {
    const double own = active_ * (trusted_ * learned_[j] + fed_back(j));
    const double effort = std::min(@NAME@_most[j], std::max(@NAME@_least[j], own + added(j)));
    static_cast<void>(command_interfaces_[j].set_value(effort));  // one that is locked keeps its last
  }
  return return_type::OK;
}

bool Feedforward::read_references()
{
  std::array<double, JOINTS * (ORDERS - 1)> found;
  for (std::size_t i = 0; i < found.size(); ++i) {
    found[i] = ordered_exported_reference_interfaces_[i]->get_optional().value_or(NOTHING);
    if (!std::isfinite(found[i])) {
      return false;  // the last that were complete are kept
    }
  }
  asked_ = found;
  return true;
}

void Feedforward::ask_model()
{
  std::array<double, @UPPER@_INPUTS> input;
  for (std::size_t i = 0; i < input.size(); ++i) {
    input[i] = asked_[SOURCES[i]];
  }
  const unsigned flags = @NAME@_mean(&state_, input.data(), learned_.data());
  answered_ = !(flags & (@UPPER@_NOT_A_NUMBER | @UPPER@_NO_ANSWER));
}

double Feedforward::fed_back(std::size_t joint)
{
  if (!feeds_back_) {
    return 0.0;
  }
  for (const std::size_t i : {joint, JOINTS + joint}) {
    measured_[i] = state_interfaces_[i].get_optional().value_or(measured_[i]);
  }
  const double fed = p_[joint] * (asked_[joint] - measured_[joint]) +
                     d_[joint] * (asked_[JOINTS + joint] - measured_[JOINTS + joint]);
  return std::isfinite(fed) ? fed : 0.0;
}

double Feedforward::added(std::size_t joint) const
{
  const auto & reference = ordered_exported_reference_interfaces_[(ORDERS - 1) * JOINTS + joint];
  const double found = reference->get_optional().value_or(0.0);
  return std::isfinite(found) ? found : 0.0;
}
}  // namespace @PACKAGE@

PLUGINLIB_EXPORT_CLASS(@PACKAGE@::Feedforward, controller_interface::ChainableControllerInterface)
