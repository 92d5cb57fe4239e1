// Estimates the battery's state of charge: /battery_current and /battery_voltage in, /battery_state out.
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>
#include <shsa_msgs/Float64Stamped.h>

#include "coulomb_counter.h"

namespace {

using shsa_rover::BatteryModel;
using shsa_rover::CoulombCounter;

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
  battery.resting_resistance = positiveParameter(node, "resting_resistance", -1.0);
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

class SocEstimator {
public:
  SocEstimator(ros::NodeHandle& node, const ros::NodeHandle& parameters)
      : battery_(readBattery(parameters)),
        counter_(battery_, positiveParameter(parameters, "longest_hold", 2.0),
                 static_cast<int>(positiveParameter(parameters, "start_samples", 50.0))) {
    publisher_ = node.advertise<sensor_msgs::BatteryState>("/battery_state", 10);
    current_ = node.subscribe("/battery_current", 1000, &SocEstimator::onCurrent, this,
                              ros::TransportHints().tcpNoDelay());
    voltage_ = node.subscribe("/battery_voltage", 1000, &SocEstimator::onVoltage, this,
                              ros::TransportHints().tcpNoDelay());
    timer_ = node.createSteadyTimer(ros::WallDuration(0.1), &SocEstimator::publish, this);
  }

private:
  void onCurrent(const shsa_msgs::Float64Stamped& message) {
    const ros::Time stamp = message.header.stamp.isZero() ? ros::Time::now() : message.header.stamp;
    const double uncounted = counter_.uncounted();
    if (!counter_.addCurrent(stamp.toSec(), message.data)) {
      ROS_WARN_THROTTLE(5.0, "A battery current that is not a number is ignored.");
    }
    if (counter_.uncounted() > uncounted) {
      ROS_WARN("No battery current for too long: %.1f s are not counted.", counter_.uncounted() - uncounted);
    }
  }

  void onVoltage(const shsa_msgs::Float64Stamped& message) {
    if (!counter_.addVoltage(message.data)) {
      ROS_WARN_THROTTLE(5.0, "A battery voltage that is not a number is ignored.");
    }
  }

  void publish(const ros::SteadyTimerEvent&) {
    if (!counter_.started()) {
      ROS_INFO_THROTTLE(10.0, "Waiting for battery current and voltage to start from.");
      return;
    }
    sensor_msgs::BatteryState state;
    state.header.stamp = ros::Time::now();
    state.header.frame_id = "battery";
    state.voltage = static_cast<float>(counter_.voltage());
    state.temperature = std::numeric_limits<float>::quiet_NaN();  // not measured
    state.current = static_cast<float>(-counter_.current());  // by the message's definition: negative discharges
    state.capacity = static_cast<float>(battery_.capacity);
    state.design_capacity = state.capacity;
    state.charge = static_cast<float>(counter_.stateOfCharge() * battery_.capacity);
    state.percentage = static_cast<float>(counter_.stateOfCharge());
    state.power_supply_status = counter_.current() > 0.0
                                    ? sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_DISCHARGING
                                    : sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_CHARGING;
    state.power_supply_technology = sensor_msgs::BatteryState::POWER_SUPPLY_TECHNOLOGY_UNKNOWN;
    state.present = true;
    publisher_.publish(state);
  }

  BatteryModel battery_;
  CoulombCounter counter_;
  ros::Publisher publisher_;
  ros::Subscriber current_;
  ros::Subscriber voltage_;
  ros::SteadyTimer timer_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "soc_estimator");
  ros::NodeHandle node;
  try {
    SocEstimator estimator(node, ros::NodeHandle("~"));
    ros::spin();
  } catch (const std::invalid_argument& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
  return 0;
}
