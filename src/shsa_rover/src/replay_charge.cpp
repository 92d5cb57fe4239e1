// Replays a recorded drive to the state-of-charge estimator: without ROS and as fast as it can.
//
// Arguments: capacity, resistance, polarisation resistance; errors of current offset, current gain,
// voltage, resistance, unknown current; samples of the reading; the open-circuit voltages. Lines in: stamp (s), current (A),
// voltage (V). Lines out, one each: state of charge and its standard deviation, or "nan nan" before the start.
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "charge_estimator.h"

int main(int argc, char** argv) {
  if (argc < 12) {
    std::fprintf(stderr, "usage: replay_charge 9 numbers, and at least two open-circuit voltages\n");
    return 2;
  }
  std::vector<double> n;
  for (int i = 1; i < argc; ++i) n.push_back(std::atof(argv[i]));
  const shsa_rover::BatteryModel battery{n[0], n[1], n[2], {n.begin() + 9, n.end()}};
  const shsa_rover::MeasurementErrors errors{n[3], n[4], n[5], n[6], n[7]};
  shsa_rover::ChargeEstimator estimator(battery, errors, 2.0, static_cast<int>(n[8]));
  double stamp, current, voltage;
  while (std::scanf("%lf %lf %lf", &stamp, &current, &voltage) == 3) {
    estimator.addVoltage(voltage);
    estimator.addCurrent(stamp, current);
    if (estimator.started()) {
      std::printf("%.9f %.9f\n", estimator.stateOfCharge(), estimator.uncertainty());
    } else {
      std::printf("nan nan\n");
    }
  }
  return 0;
}
