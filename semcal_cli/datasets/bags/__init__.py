"""Recordings of ROS 1 and ROS 2 (`.bag`, MCAP, sqlite3) become drives, without ROS."""
