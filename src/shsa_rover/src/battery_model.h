#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace shsa_rover {

/// What is known of a battery: capacity in Ah, resistances in Ohm, and the open-circuit voltages in V
/// for states of charge that rise evenly from 0 to 1 (at least two, rising).
struct BatteryModel {
  double capacity;
  double resistance;               ///< of the sag that follows the current at once
  double polarisation_resistance;  ///< of the sag that follows it slowly
  std::vector<double> open_circuit;

  /// The state of charge, 0 to 1, at the open-circuit voltage `source` (V).
  double stateOfCharge(double source) const {
    const std::size_t i = segment(source);
    const double share = (source - open_circuit[i - 1]) / (open_circuit[i] - open_circuit[i - 1]);
    return std::min(1.0, std::max(0.0, (static_cast<double>(i - 1) + share) / segments()));
  }

  /// By how much the state of charge rises, for each volt, at the open-circuit voltage `source` (V).
  double chargePerVolt(double source) const {
    const std::size_t i = segment(source);
    return 1.0 / segments() / (open_circuit[i] - open_circuit[i - 1]);
  }

private:
  double segments() const { return static_cast<double>(open_circuit.size() - 1); }

  std::size_t segment(double source) const {
    std::size_t i = 1;
    while (i + 1 < open_circuit.size() && source > open_circuit[i]) ++i;
    return i;
  }
};

/// How far off the measurements may be: standard deviations of errors that stay the same for long.
struct MeasurementErrors {
  double current_offset;  ///< A
  double current_gain;    ///< share of the current; with the capacity's
  double voltage;         ///< V; with what the table of open-circuit voltages is off by
  double resistance;      ///< Ohm
  double unknown_current;  ///< A: how much the current that flowed before may have differed from the first one seen
};

}  // namespace shsa_rover
