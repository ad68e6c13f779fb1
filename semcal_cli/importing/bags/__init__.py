"""Import of recordings of ROS 1, ROS 2 and Foxglove (`.bag`, MCAP, sqlite3), without ROS."""
