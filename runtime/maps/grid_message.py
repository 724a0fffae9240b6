"""An occupancy grid as nav_msgs/OccupancyGrid."""

from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import header, ros_pose
from slam.maps.occupancy_grid import GridMap
from slam.pose import Pose2

GRID = "nav_msgs/msg/OccupancyGrid"


def grid_bytes(grid: GridMap, wall_ns: int) -> bytes:
    """In the frame map; -1 unknown, 0 free, 100 occupied, as the message wants it, row by row from the lowest y."""
    stamped = header(wall_ns, "map")
    rows, columns = grid.occupancy.shape
    info = construct(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamped.stamp,
        resolution=grid.resolution_m,
        width=columns,
        height=rows,
        origin=ros_pose(Pose2(*grid.origin_m)),
    )
    return serialize(GRID, construct(GRID, header=stamped, info=info, data=grid.occupancy.ravel()))
