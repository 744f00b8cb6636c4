"""A model as a package of ROS 2: a chainable controller of ros2_control around its C."""
