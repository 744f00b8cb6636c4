// Runs the exported controller as a controller manager would: one line of numbers in and one of efforts out each step.
// Arguments: p, d, how many of each, how often to activate. Lines: period, references (position, velocity, acceleration, effort of all joints), states (position, velocity).
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <string>

#include HEADER

static bool counting = false;
static unsigned allocated = 0;

void * operator new(std::size_t size)
{
  allocated += counting;
  void * found = std::malloc(size);
  if (!found) {
    throw std::bad_alloc();
  }
  return found;
}
void operator delete(void * own) noexcept { std::free(own); }
void operator delete(void * own, std::size_t) noexcept { std::free(own); }

using Handles = std::vector<hardware_interface::CommandInterface::SharedPtr>;

static Handles made(const std::vector<std::string> & names)
{
  Handles found;
  for (const auto & name : names) {
    const auto cut = name.rfind('/');
    found.push_back(
      std::make_shared<hardware_interface::CommandInterface>(name.substr(0, cut), name.substr(cut + 1)));
  }
  return found;
}

static std::vector<hardware_interface::Loaned> loaned(const Handles & own)
{
  return std::vector<hardware_interface::Loaned>(own.begin(), own.end());
}

static void print(const Handles & own)
{
  for (const auto & one : own) {
    std::printf("%.17g ", one->value);
  }
  std::printf("\n");
}

static double number()
{
  std::string word;
  std::cin >> word;
  return std::strtod(word.c_str(), nullptr);  // takes nan and inf, as >> does not
}

int main(int count, char ** words)
{
  PACKAGE::Feedforward own;
  const std::size_t J = PACKAGE::Feedforward::JOINTS;
  const rclcpp_lifecycle::State state;
  const rclcpp::Time time;
  const double gain = count > 1 ? std::atof(words[1]) : 0.0, damping = count > 2 ? std::atof(words[2]) : 0.0;
  const std::size_t gains = count > 3 ? std::atoi(words[3]) : J;
  if (gain > 0.0) {
    own.get_node()->parameters["p"].value = std::vector<double>(gains, gain);
    own.get_node()->parameters["d"].value = std::vector<double>(gains, damping);
  }
  if (own.on_init() != controller_interface::CallbackReturn::SUCCESS ||
      own.on_configure(state) != controller_interface::CallbackReturn::SUCCESS) {
    return 3;
  }
  const Handles references = own.export_reference_interfaces();
  const Handles commands = made(own.command_interface_configuration().names);
  const Handles states = made(own.state_interface_configuration().names);
  for (const Handles & all : {references, commands, states}) {
    for (const auto & one : all) {
      std::printf("%s ", one->get_name().c_str());
    }
    std::printf("\n");
  }
  own.assign_interfaces(loaned(commands), loaned(states));
  std::vector<double> rows;
  for (double found = number(); std::cin; found = number()) {
    rows.push_back(found);
  }
  const std::size_t width = 1 + references.size() + 2 * J;
  for (int run = count > 4 ? std::atoi(words[4]) : 1; run > 0; --run) {
    own.on_activate(state);
    for (std::size_t row = 0; row + width <= rows.size(); row += width) {
      const double * next = &rows[row];
      const double period = *next++;
      for (const auto & one : references) {
        one->value = *next++;
      }
      for (std::size_t i = 0; i < states.size(); ++i) {
        states[i]->value = next[i];
      }
      counting = true;
      const auto done = own.update(time, rclcpp::Duration(period));
      counting = false;
      if (done != controller_interface::return_type::OK) {
        return 4;
      }
      print(commands);
    }
    own.on_deactivate(state);
    print(commands);
  }
  std::printf("%u allocations\n", allocated);
  return 0;
}
