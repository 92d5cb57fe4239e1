// An application node as there are many on a robot: publishes /application_N and hears that of another one.
// Usage: bench_application NUMBER RATE: RATE in Hz; 0: idle, it publishes nothing.
#include <ros/ros.h>
#include <shsa_msgs/Float64Stamped.h>

#include <cstdlib>
#include <iostream>
#include <string>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "application", ros::init_options::AnonymousName);
  if (argc != 3)
  {
    std::cerr << "usage: bench_application NUMBER RATE" << std::endl;
    return 2;
  }
  const int number = std::atoi(argv[1]);
  const double rate = std::atof(argv[2]);
  ros::NodeHandle node;
  shsa_msgs::Float64Stamped message;
  ros::Publisher publisher =
      node.advertise<shsa_msgs::Float64Stamped>("/application_" + std::to_string(number), 10);
  ros::Subscriber subscriber = node.subscribe<shsa_msgs::Float64Stamped>(
      "/application_" + std::to_string(number ? number - 1 : 0), 10,
      [&message](const shsa_msgs::Float64Stamped::ConstPtr& heard) { message.data = heard->data + 1.0; });
  ros::WallTimer timer;
  if (rate > 0.0)
  {
    timer = node.createWallTimer(ros::WallDuration(1.0 / rate), [&](const ros::WallTimerEvent&) {
      message.header.stamp = ros::Time::now();
      publisher.publish(message);
    });
  }
  ros::spin();
  return 0;
}
