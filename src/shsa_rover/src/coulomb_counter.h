#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace shsa_rover {

/// What is known of a battery: capacity in Ah, resistance in Ohm, and the open-circuit voltages in V
/// for states of charge that rise evenly from 0 to 1 (at least two, rising).
struct BatteryModel {
  double capacity;
  double resting_resistance;
  std::vector<double> open_circuit;

  /// The state of charge, 0 to 1, of a battery that shows `voltage` (V) while it supplies `current` (A).
  double stateOfCharge(double voltage, double current) const {
    const double source = voltage + resting_resistance * current;
    if (source <= open_circuit.front()) return 0.0;
    if (source >= open_circuit.back()) return 1.0;
    std::size_t i = 1;
    while (source > open_circuit[i]) ++i;
    const double share = (source - open_circuit[i - 1]) / (open_circuit[i] - open_circuit[i - 1]);
    return (static_cast<double>(i - 1) + share) / static_cast<double>(open_circuit.size() - 1);
  }
};

/// Coulomb counting: integrates the current over the samples' stamps, and starts from the open-circuit voltage.
class CoulombCounter {
public:
  /// `longest_hold`: for so many seconds the last current is held over a gap; beyond that nothing is counted.
  /// `start_samples`: how many samples of current and of voltage the start value is averaged over.
  CoulombCounter(const BatteryModel& battery, double longest_hold, int start_samples)
      : battery_(battery), longest_hold_(longest_hold), start_samples_(start_samples) {}

  /// Takes a current (A, positive while discharging) measured at `stamp` (s). False if it is of no use.
  bool addCurrent(double stamp, double current) {
    if (!std::isfinite(stamp) || !std::isfinite(current)) return false;
    if (started_) {
      count(stamp);
    } else {
      current_mean_.add(current);
    }
    stamp_ = stamp;
    current_ = current;
    start();
    return true;
  }

  /// Takes a voltage (V); only the start value needs it. False if it is of no use.
  bool addVoltage(double voltage) {
    if (!std::isfinite(voltage)) return false;
    voltage_ = voltage;
    if (!started_) voltage_mean_.add(voltage);
    start();
    return true;
  }

  bool started() const { return started_; }
  /// 0 to 1.
  double stateOfCharge() const { return state_of_charge_; }
  /// The last good current in A; not a number before the first.
  double current() const { return current_; }
  /// The last good voltage in V; not a number before the first.
  double voltage() const { return voltage_; }
  /// Seconds for which no current was known and nothing was counted.
  double uncounted() const { return uncounted_; }

private:
  struct Mean {
    void add(double value) { sum += value; ++number; }
    double value() const { return sum / number; }
    double sum = 0.0;
    int number = 0;
  };

  void start() {
    if (started_ || current_mean_.number < start_samples_ || voltage_mean_.number < start_samples_) return;
    state_of_charge_ = battery_.stateOfCharge(voltage_mean_.value(), current_mean_.value());
    started_ = true;
  }

  void count(double stamp) {
    // A stamp that jumps back tells no duration: counting goes on from it.
    const double passed = std::max(0.0, stamp - stamp_);
    const double held = std::min(passed, longest_hold_);
    uncounted_ += passed - held;
    const double used = current_ * held / 3600.0 / battery_.capacity;
    state_of_charge_ = std::min(1.0, std::max(0.0, state_of_charge_ - used));
  }

  BatteryModel battery_;
  double longest_hold_;
  int start_samples_;
  bool started_ = false;
  double stamp_ = 0.0;
  double current_ = std::numeric_limits<double>::quiet_NaN();
  double voltage_ = std::numeric_limits<double>::quiet_NaN();
  double state_of_charge_ = 0.0;
  double uncounted_ = 0.0;
  Mean current_mean_;
  Mean voltage_mean_;
};

}  // namespace shsa_rover
