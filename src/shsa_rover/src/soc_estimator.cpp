// Estimates the battery's state of charge: /battery_current in, /battery_state out. Where no state of charge is known
// (from before, or by ~state_of_charge), it starts from the first second of /battery_voltage, and listens to that no more.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>
#include <shsa_msgs/Float64Stamped.h>

#include "charge_estimator.h"
#include "saved_charge.h"

namespace {

using shsa_rover::BatteryModel;
using shsa_rover::ChargeEstimator;
using shsa_rover::MeasurementErrors;
using shsa_rover::SavedCharge;
using shsa_rover::loadCharge;
using shsa_rover::saveCharge;

const double kSavePeriod = 10.0;  // s

double positiveParameter(const ros::NodeHandle& node, const std::string& name, double fallback) {
  double value = fallback;
  if (node.hasParam(name) && !node.getParam(name, value)) value = -1.0;
  if (!std::isfinite(value) || value <= 0.0) {
    throw std::invalid_argument(node.resolveName(name) + " must be set to a number greater than 0");
  }
  return value;
}

BatteryModel readBattery(const ros::NodeHandle& node) {
  BatteryModel battery;
  battery.capacity = positiveParameter(node, "capacity", -1.0);
  battery.resistance = positiveParameter(node, "resistance", -1.0);
  battery.polarisation_resistance = positiveParameter(node, "polarisation_resistance", -1.0);
  node.getParam("open_circuit", battery.open_circuit);
  bool rising = battery.open_circuit.size() >= 2;
  for (std::size_t i = 1; i < battery.open_circuit.size(); ++i) {
    rising = rising && battery.open_circuit[i] > battery.open_circuit[i - 1];
  }
  if (!rising) {
    throw std::invalid_argument(node.resolveName("open_circuit") +
                                " must be set to a list of at least two rising voltages");
  }
  return battery;
}

MeasurementErrors readErrors(const ros::NodeHandle& node) {
  MeasurementErrors errors;
  errors.current_offset = positiveParameter(node, "errors/current_offset", -1.0);
  errors.current_gain = positiveParameter(node, "errors/current_gain", -1.0);
  errors.voltage = positiveParameter(node, "errors/voltage", -1.0);
  errors.resistance = positiveParameter(node, "errors/resistance", -1.0);
  errors.unknown_current = positiveParameter(node, "errors/unknown_current", -1.0);
  return errors;
}

/// `~state_file`, or a file by the node's name in the folder of ROS.
std::string stateFile(const ros::NodeHandle& node) {
  const std::string told = node.param<std::string>("state_file", "");
  if (!told.empty()) return told;
  const char* folder = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  std::string name = ros::this_node::getName();
  for (char& letter : name) letter = letter == '/' ? '_' : letter;
  return (folder ? std::string(folder) : std::string(home ? home : ".") + "/.ros") + "/charge" + name;
}

class SocEstimator {
public:
  SocEstimator(ros::NodeHandle& node, const ros::NodeHandle& parameters)
      : battery_(readBattery(parameters)),
        errors_(readErrors(parameters)),
        estimator_(battery_, errors_, positiveParameter(parameters, "longest_hold", 2.0),
                   static_cast<int>(positiveParameter(parameters, "reading_samples", 50.0))),
        state_file_(stateFile(parameters)),
        longest_absence_(positiveParameter(parameters, "longest_absence", 600.0)),
        other_runs_(parameters.param("state_of_other_runs", true)) {
    run_ = node.param<std::string>("/run_id", "-");
    restore();
    if (!estimator_.started() && parameters.hasParam("state_of_charge")) {
      estimator_.start(std::min(1.0, positiveParameter(parameters, "state_of_charge", -1.0)), 0.0);
    }
    publisher_ = node.advertise<sensor_msgs::BatteryState>("battery_state", 10);
    uncertainty_ = node.advertise<shsa_msgs::Float64Stamped>("battery_state/uncertainty", 10);
    current_ = node.subscribe("battery_current", 1000, &SocEstimator::onCurrent, this,
                              ros::TransportHints().tcpNoDelay());
    if (!estimator_.started()) {
      voltage_ = node.subscribe("battery_voltage", 1000, &SocEstimator::onVoltage, this,
                                ros::TransportHints().tcpNoDelay());
    }
    timer_ = node.createSteadyTimer(ros::WallDuration(0.1), &SocEstimator::publish, this);
    save_timer_ = node.createSteadyTimer(ros::WallDuration(kSavePeriod), &SocEstimator::onSave, this);
  }

  /// Keeps the estimate for the next start.
  void save() const {
    if (!estimator_.started()) return;
    try {
      saveCharge(state_file_, {estimator_.stateOfCharge(), estimator_.uncertainty(), ros::WallTime::now().toSec(), run_});
    } catch (const std::runtime_error& error) {
      ROS_WARN_THROTTLE(600.0, "The state of charge cannot be kept for a restart: %s.", error.what());
    }
  }

private:
  /// Goes on from the last estimate, as far as it can be believed.
  void restore() {
    SavedCharge saved;
    try {
      if (!loadCharge(state_file_, saved)) return;
    } catch (const std::runtime_error& error) {
      ROS_WARN("The last state of charge is ignored: %s.", error.what());
      return;
    }
    if (!other_runs_ && saved.run != run_) return;  // another simulation's battery
    const double absence = ros::WallTime::now().toSec() - saved.time;
    if (absence < 0.0) {
      ROS_WARN("The last state of charge is ignored: it is dated later than now (%s).", state_file_.c_str());
      return;
    }
    if (absence > longest_absence_) {
      ROS_WARN("The last state of charge, %.1f %%, is ignored: it is %.0f s old, and at most %.0f s are allowed (%s).",
               100.0 * saved.state_of_charge, absence, longest_absence_, state_file_.c_str());
      return;
    }
    const double unknown = errors_.unknown_current * absence / 3600.0 / battery_.capacity;
    estimator_.start(saved.state_of_charge, saved.uncertainty + unknown);
    ROS_INFO("The state of charge goes on from %.1f %%, %.0f s ago.", 100.0 * saved.state_of_charge, absence);
  }

  void onCurrent(const shsa_msgs::Float64Stamped& message) {
    const ros::Time stamp = message.header.stamp.isZero() ? ros::Time::now() : message.header.stamp;
    const double uncounted = estimator_.uncounted();
    if (!estimator_.addCurrent(stamp.toSec(), message.data)) {
      ROS_WARN_THROTTLE(5.0, "A battery current that is not a number is ignored.");
    }
    if (estimator_.uncounted() > uncounted) {
      ROS_WARN("No battery current for too long: %.1f s are not counted.", estimator_.uncounted() - uncounted);
    }
    needVoltage();
  }

  void onVoltage(const shsa_msgs::Float64Stamped& message) {
    if (!estimator_.addVoltage(message.data)) {
      ROS_WARN_THROTTLE(5.0, "A battery voltage that is not a number is ignored.");
    }
    needVoltage();
  }

  void onSave(const ros::SteadyTimerEvent&) { save(); }

  /// Stops listening to the voltage once it has told the start.
  void needVoltage() {
    if (!estimator_.started() || !voltage_) return;
    voltage_.shutdown();
    ROS_INFO("The state of charge starts from %.1f %%, by the voltage.", 100.0 * estimator_.stateOfCharge());
  }

  void publish(const ros::SteadyTimerEvent&) {
    if (!estimator_.started()) {
      ROS_INFO_THROTTLE(10.0, "Waiting for battery current and voltage to start from.");
      return;
    }
    sensor_msgs::BatteryState state;
    state.header.stamp = ros::Time::now();
    state.header.frame_id = "battery";
    state.voltage = std::numeric_limits<float>::quiet_NaN();  // not listened to
    state.temperature = std::numeric_limits<float>::quiet_NaN();  // not measured
    state.current = static_cast<float>(-estimator_.current());  // by the message's definition: negative discharges
    state.capacity = static_cast<float>(battery_.capacity);
    state.design_capacity = state.capacity;
    state.charge = static_cast<float>(estimator_.stateOfCharge() * battery_.capacity);
    state.percentage = static_cast<float>(estimator_.stateOfCharge());
    state.power_supply_status = estimator_.current() > 0.0
                                    ? sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_DISCHARGING
                                    : sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_CHARGING;
    state.power_supply_technology = sensor_msgs::BatteryState::POWER_SUPPLY_TECHNOLOGY_UNKNOWN;
    state.present = true;
    publisher_.publish(state);
    shsa_msgs::Float64Stamped uncertainty;
    uncertainty.header = state.header;
    uncertainty.data = estimator_.uncertainty();
    uncertainty_.publish(uncertainty);
  }

  BatteryModel battery_;
  MeasurementErrors errors_;
  ChargeEstimator estimator_;
  std::string state_file_;
  double longest_absence_;
  bool other_runs_;
  std::string run_;
  ros::Publisher publisher_;
  ros::Publisher uncertainty_;
  ros::Subscriber current_;
  ros::Subscriber voltage_;
  ros::SteadyTimer timer_;
  ros::SteadyTimer save_timer_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "soc_estimator");
  ros::NodeHandle node;
  try {
    SocEstimator estimator(node, ros::NodeHandle("~"));
    ros::spin();
    estimator.save();
  } catch (const std::invalid_argument& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
  return 0;
}
