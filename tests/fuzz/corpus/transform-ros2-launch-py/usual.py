from launch_ros.actions import Node
node = Node(executable='static_transform_publisher', arguments=['--x', '0.009899451202430798', '--y', '-0.0021674951545614758', '--z', '-0.6287267314427195', '--qx', '-0.6006911810871346', '--qy', '-0.05190235610027612', '--qz', '-0.35982000738281317', '--qw', '0.7120434064594766', '--frame-id', 'os_sensor', '--child-frame-id', 'cam_optical'])
