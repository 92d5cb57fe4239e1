#pragma once

#include <string>

namespace shsa_rover {

/// An estimate on disk: a state of charge and its standard deviation (0 to 1), the wall-clock time in s, and the run
/// of the ROS master in which it was written.
struct SavedCharge {
  double state_of_charge;
  double uncertainty;
  double time;
  std::string run;
};

/// Writes `charge` to `path`: after a crash there is the old file or the new one. Throws std::runtime_error.
void saveCharge(const std::string& path, const SavedCharge& charge);

/// Reads what `saveCharge` wrote. False if there is no file; throws std::runtime_error if it is not such a file.
bool loadCharge(const std::string& path, SavedCharge& charge);

}  // namespace shsa_rover
