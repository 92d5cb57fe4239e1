// A consumer in roscpp: prints every message of its topics with the monotonic time at which it came.
// Usage: bench_consumer TOPIC...  Lines: `message TIME TOPIC NODE VALUE STAMP FRAME`, TIME and STAMP in s.
#include <ros/ros.h>
#include <shsa_msgs/Float64Stamped.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

using Event = ros::MessageEvent<shsa_msgs::Float64Stamped const>;

static void print(const std::string& topic, const Event& event)
{
  const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
  const shsa_msgs::Float64Stamped& message = *event.getConstMessage();
  std::printf("message %.6f %s %s %g %.6f %s\n", now.count(), topic.c_str(), event.getPublisherName().c_str(),
              message.data, message.header.stamp.toSec(), message.header.frame_id.c_str());
  std::fflush(stdout);
}

int main(int argc, char** argv)
{
  ros::init(argc, argv, "consumer", ros::init_options::AnonymousName);
  ros::NodeHandle node;
  std::vector<ros::Subscriber> subscribers;
  for (int i = 1; i < argc; ++i)
  {
    const std::string topic = argv[i];
    const boost::function<void(const Event&)> heard = [topic](const Event& event) { print(topic, event); };
    subscribers.push_back(node.subscribe<shsa_msgs::Float64Stamped>(
        topic, 1000, heard, ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay()));
  }
  ros::spin();
  return 0;
}
