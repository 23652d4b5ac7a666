"""Files: logs, bags, occupancy grids, pose graphs, trajectories, tables, reference sets.

- logs of CARMEN, old and new, plain or gzipped: `aprjax.read_log`; `carmen_writer.write_log`
- bags of ROS 1, and of ROS 2 in SQLite and MCAP files, by the extra `aprjax[rosbag]`:
  `aprjax.read_log`
- reference sets, a format of this package: `aprjax.load_references`, `aprjax.save_references`
- maps, a format of this package: `aprjax.load_map`, `aprjax.save_map`
- occupancy grids of map_server, YAML and PGM: `aprjax.read_occupancy_grid`,
  `aprjax.write_occupancy_grid`
- pose graphs of the plane, g2o and TORO: `aprjax.read_pose_graph`, `aprjax.write_pose_graph`
- trajectories in TUM's format, which `evo` reads: `aprjax.read_tum`, `aprjax.write_tum`

What is read is not trusted: a file that cannot be used raises the error that its reader names, one
line with the path, the place in the file and the reason. So does a pipe or a device: files are read
more than once. What is written is complete or not there.
"""
