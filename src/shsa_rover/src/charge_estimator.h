#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "battery_model.h"

namespace shsa_rover {

/// The state of charge by coulomb counting, and how uncertain it is.
///
/// It integrates the current over the samples' stamps, from a state of charge that was known before or else is read
/// from the voltage, once: open-circuit voltage = voltage + sag. After that nothing but the current moves the estimate.
///
/// The reading is uncertain by the voltmeter, by the resistance at the present current, and by the current that flowed
/// before the first sample, on which the slow part of the sag depends.
class ChargeEstimator {
public:
  /// `longest_hold`: for so many seconds the last current is held over a gap; beyond that nothing is counted.
  /// `samples`: how many of current and of voltage the reading is averaged over.
  ChargeEstimator(const BatteryModel& battery, const MeasurementErrors& errors, double longest_hold, int samples)
      : battery_(battery), errors_(errors), longest_hold_(longest_hold), samples_(samples) {}

  /// Goes on from a state of charge (0 to 1) that was known before, with its standard deviation.
  void start(double state_of_charge, double uncertainty) {
    state_of_charge_ = state_of_charge;
    start_error_ = uncertainty;
    started_ = true;
  }

  /// Takes a current (A, positive while discharging) measured at `stamp` (s). False if it is of no use.
  bool addCurrent(double stamp, double current) {
    if (!std::isfinite(stamp) || !std::isfinite(current)) return false;
    if (std::isfinite(current_)) count(stamp);
    stamp_ = stamp;
    current_ = current;
    currents_.add(current);
    read();
    return true;
  }

  /// Takes a voltage (V), which counts until the estimator has started. False if it is of no use.
  bool addVoltage(double voltage) {
    if (!std::isfinite(voltage)) return false;
    voltages_.add(voltage);
    read();
    return true;
  }

  bool started() const { return started_; }
  /// 0 to 1.
  double stateOfCharge() const { return state_of_charge_; }
  /// Standard deviation of the state of charge. What was counted is off by always the same: it grows with time.
  double uncertainty() const { return std::min(1.0, std::hypot(start_error_, counted_error_)); }
  /// The last good current in A; not a number before the first.
  double current() const { return current_; }
  /// Seconds for which no current was known and nothing was counted.
  double uncounted() const { return uncounted_; }

private:
  struct Mean {
    void add(double value) { sum += value; ++number; }
    double value() const { return sum / number; }
    double sum = 0.0;
    int number = 0;
  };

  void count(double stamp) {
    // A stamp that jumps back tells no duration: counting goes on from it.
    const double passed = std::max(0.0, stamp - stamp_);
    const double held = std::min(passed, longest_hold_);
    uncounted_ += passed - held;
    counted_error_ += charge(std::abs(current_) * (passed - held));  // what flowed meanwhile is not known
    counted_error_ += charge((errors_.current_offset + errors_.current_gain * std::abs(current_)) * held);
    if (started_) state_of_charge_ = std::min(1.0, std::max(0.0, state_of_charge_ - charge(current_ * held)));
  }

  void read() {
    if (started_ || currents_.number < samples_ || voltages_.number < samples_) return;
    const double current = currents_.value();
    const double sag = (battery_.resistance + battery_.polarisation_resistance) * current;
    const double source = voltages_.value() + sag;
    const double before = battery_.polarisation_resistance * errors_.unknown_current;
    const double error = std::hypot(errors_.voltage, std::hypot(before, errors_.resistance * std::abs(current)));
    start(battery_.stateOfCharge(source), battery_.chargePerVolt(source) * error);
    counted_error_ = 0.0;
  }

  /// The share of the battery's capacity that `coulombs` are.
  double charge(double coulombs) const { return coulombs / 3600.0 / battery_.capacity; }

  BatteryModel battery_;
  MeasurementErrors errors_;
  double longest_hold_;
  int samples_;
  bool started_ = false;
  double stamp_ = 0.0;
  double current_ = std::numeric_limits<double>::quiet_NaN();
  double state_of_charge_ = 0.0;
  double start_error_ = 0.0;
  double counted_error_ = 0.0;
  double uncounted_ = 0.0;
  Mean currents_;
  Mean voltages_;
};

}  // namespace shsa_rover
