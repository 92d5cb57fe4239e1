// Publishes a count, or one value, on a topic at a steady rate.
// Usage: bench_talker TOPIC PERIOD [VALUE]: PERIOD in s.
#include <ros/ros.h>
#include <shsa_msgs/Float64Stamped.h>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <thread>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "talker", ros::init_options::AnonymousName);
  const double period = argc >= 3 ? std::atof(argv[2]) : 0.0;
  if (period <= 0.0)
  {
    std::cerr << "usage: bench_talker TOPIC PERIOD [VALUE]" << std::endl;
    return 2;
  }
  using Clock = std::chrono::steady_clock;
  const auto step = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(period));
  ros::NodeHandle node;
  ros::Publisher publisher = node.advertise<shsa_msgs::Float64Stamped>(argv[1], 100);
  shsa_msgs::Float64Stamped message;
  const bool counts = argc < 4;
  message.data = counts ? 0.0 : std::atof(argv[3]);
  for (auto due = Clock::now(); ros::ok(); due += step)
  {
    std::this_thread::sleep_until(due);
    message.header.stamp = ros::Time::now();
    message.data += counts ? 1.0 : 0.0;
    publisher.publish(message);
  }
  return 0;
}
