"""Drives as the commands read them."""

import argparse

import numpy as np

from aprjax.cli.inputs import add_laser, add_topic_options, read_drive
from aprjax.plane import compose
from tests.make_logs import write_logs


def drive(path, *options):
    parser = argparse.ArgumentParser()
    add_laser(parser)
    add_topic_options(parser, odometry=True)
    arguments = parser.parse_args(list(options), argparse.Namespace(log=path, strict=False))
    return np.array([entry.odometry for entry in read_drive(arguments)])


def test_the_odometry_of_a_log_is_of_the_laser_that_is_mounted_somewhere(tmp_path):
    log = write_logs(tmp_path)[0]
    mounted = drive(log, "--laser=0.3,-0.1,90")
    np.testing.assert_allclose(mounted, compose(drive(log), np.array([0.3, -0.1, np.pi / 2])))


def test_a_log_by_whose_odometry_the_robot_never_moves_is_told(tmp_path, capsys):
    path = tmp_path / "still.log"
    scan = "FLASER 3 1 1 1 1 2 0 1 2 0 0 h 0\n"
    path.write_text(f"{scan}ODOM 1 2 0 0 0 0 0 h 0\n{scan}{scan}")
    np.testing.assert_array_equal(drive(path), np.zeros((3, 3)))
    assert capsys.readouterr().err == f"{path}: by its odometry the robot never moves\n"
