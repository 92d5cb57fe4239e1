#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "battery_model.h"

namespace shsa_rover {

/// The state of charge by coulomb counting, and how uncertain it is.
///
/// It integrates the current over the samples' stamps. Every so many samples it also reads the state of charge from
/// the voltage, while the current is that of rest: open-circuit voltage = voltage + sag, of which the slow part is
/// followed along. A reading is taken where it may be off by clearly less than what was counted. So a start while
/// moving is corrected in the next rests, and long counting is corrected now and then; in between, nothing but the
/// current moves the estimate.
///
/// A reading is uncertain by the voltmeter, by the resistance at the present current, and by the current that flowed
/// before the first sample, which is forgotten within the polarisation's time. None of these errors is noise: readings
/// are compared, never averaged.
class ChargeEstimator {
public:
  /// `longest_hold`: for so many seconds the last current is held over a gap; beyond that nothing is counted.
  /// `samples`: how many of current and of voltage a reading is averaged over.
  ChargeEstimator(const BatteryModel& battery, const MeasurementErrors& errors, const Rest& rest, double longest_hold,
                  int samples)
      : battery_(battery), errors_(errors), rest_(rest), longest_hold_(longest_hold), samples_(samples) {}

  /// Goes on from a state of charge (0 to 1) that was known before, with its standard deviation.
  void restore(double state_of_charge, double uncertainty) {
    set(state_of_charge, uncertainty);
    restored_ = true;
  }

  /// Takes a current (A, positive while discharging) measured at `stamp` (s). False if it is of no use.
  bool addCurrent(double stamp, double current) {
    if (!std::isfinite(stamp) || !std::isfinite(current)) return false;
    if (std::isfinite(current_)) count(stamp);
    stamp_ = stamp;
    current_ = current;
    current_mean_.add(current);
    read();
    return true;
  }

  /// Takes a voltage (V). False if it is of no use.
  bool addVoltage(double voltage) {
    if (!std::isfinite(voltage)) return false;
    voltage_ = voltage;
    voltage_mean_.add(voltage);
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
  /// The last good voltage in V; not a number before the first.
  double voltage() const { return voltage_; }
  /// Seconds for which no current was known and nothing was counted.
  double uncounted() const { return uncounted_; }
  /// True as long as the estimate stems from what was restored.
  bool restored() const { return restored_; }
  /// How many readings disagreed with the estimate by more than both may be off.
  int contradictions() const { return contradictions_; }
  /// The state of charge by the last reading.
  double lastReading() const { return last_reading_; }

private:
  static constexpr double kBetter = 1.25;   // times: a reading that is taken is as much more certain
  static constexpr double kDisagreement = 3.0;  // standard deviations

  struct Mean {
    void add(double value) { sum += value; squares += value * value; ++number; }
    double value() const { return sum / number; }
    double spread() const { return std::sqrt(std::max(0.0, squares / number - value() * value())); }
    double sum = 0.0;
    double squares = 0.0;
    int number = 0;
  };

  void set(double state_of_charge, double uncertainty) {
    state_of_charge_ = state_of_charge;
    start_error_ = uncertainty;
    counted_error_ = 0.0;
    started_ = true;
  }

  void count(double stamp) {
    // A stamp that jumps back tells no duration: counting goes on from it.
    const double passed = std::max(0.0, stamp - stamp_);
    const double held = std::min(passed, longest_hold_);
    if (passed > held) {
      // What flowed meanwhile is not known, and neither is the sag.
      uncounted_ += passed - held;
      counted_error_ += charge(std::abs(current_) * (passed - held));
      heard_ = 0.0;
      polarised_ = false;
      current_mean_ = voltage_mean_ = Mean();
    }
    counted_error_ += charge((errors_.current_offset + errors_.current_gain * std::abs(current_)) * held);
    heard_ += held;
    const double settled = battery_.polarisation_resistance * current_;
    polarisation_ += (settled - polarisation_) * -std::expm1(-held / battery_.polarisation_time);
    if (started_) state_of_charge_ = std::min(1.0, std::max(0.0, state_of_charge_ - charge(current_ * held)));
  }

  void read() {
    if (current_mean_.number < samples_ || voltage_mean_.number < samples_) return;
    const Mean current = current_mean_, voltage = voltage_mean_;
    current_mean_ = voltage_mean_ = Mean();
    if (!polarised_) polarisation_ = battery_.polarisation_resistance * current.value();
    polarised_ = true;
    // Before the first reading nothing is known: then a moving one is better than none.
    const bool rests = std::abs(current.value()) <= rest_.current && current.spread() <= rest_.spread;
    if (started_ && !rests) return;
    const double source = voltage.value() + battery_.resistance * current.value() + polarisation_;
    const double forgotten = std::exp(-heard_ / battery_.polarisation_time);
    const double before = battery_.polarisation_resistance * errors_.unknown_current * forgotten;
    const double sag = errors_.resistance * std::abs(current.value());
    const double error = battery_.chargePerVolt(source) * std::hypot(errors_.voltage, std::hypot(before, sag));
    last_reading_ = battery_.stateOfCharge(source);
    judge(error, forgotten);
  }

  void judge(double error, double forgotten) {
    const double off = started_ ? std::abs(last_reading_ - state_of_charge_) : 0.0;
    const bool contradicts = off > kDisagreement * std::hypot(error, uncertainty());
    contradictions_ += contradicts;
    // Whoever counted may know better than the voltage; what was only remembered may be of another battery.
    const bool better = kBetter * error < uncertainty();
    if (!started_ || (contradicts ? restored_ : better)) {
      set(last_reading_, error);
      restored_ = false;
    }
    if (forgotten < 0.05) restored_ = false;  // the voltage has confirmed it
  }

  /// The share of the battery's capacity that `coulombs` are.
  double charge(double coulombs) const { return coulombs / 3600.0 / battery_.capacity; }

  BatteryModel battery_;
  MeasurementErrors errors_;
  Rest rest_;
  double longest_hold_;
  int samples_;
  bool started_ = false;
  bool restored_ = false;
  bool polarised_ = false;
  double stamp_ = 0.0;
  double current_ = std::numeric_limits<double>::quiet_NaN();
  double voltage_ = std::numeric_limits<double>::quiet_NaN();
  double state_of_charge_ = 0.0;
  double start_error_ = 0.0;
  double counted_error_ = 0.0;
  double polarisation_ = 0.0;
  double heard_ = 0.0;
  double uncounted_ = 0.0;
  double last_reading_ = 0.0;
  int contradictions_ = 0;
  Mean current_mean_;
  Mean voltage_mean_;
};

}  // namespace shsa_rover
