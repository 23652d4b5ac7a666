import numpy as np
import pytest

from aprjax.io.trajectory import TrajectoryError, read_tum, write_tum

STAMPS = 1e9 + np.array([0.0, 0.2, 0.400001])
POSES = np.array([[0.0, 0.0, 0.0], [1.5, -2.25, 3.1], [-1234.567891234, 1e-7, -3.1]])


def test_poses_come_back(tmp_path):
    write_tum(tmp_path / "t.tum", STAMPS, POSES)
    stamps, poses = read_tum(tmp_path / "t.tum")
    np.testing.assert_allclose(stamps, STAMPS, atol=1e-6, rtol=0)
    np.testing.assert_allclose(poses, POSES, atol=2e-9, rtol=0)


def test_headings_come_back_within_half_a_turn_to_each_side(tmp_path):
    theta = np.linspace(-20, 20, 401)
    poses = np.stack([theta, theta, theta], axis=-1)
    write_tum(tmp_path / "t.tum", np.arange(401.0), poses)
    read = read_tum(tmp_path / "t.tum")[1][:, 2]
    assert np.all(abs(read) <= np.pi)
    np.testing.assert_allclose(np.exp(1j * read), np.exp(1j * theta), atol=5e-9)


def test_the_columns_are_those_of_tum(tmp_path):
    write_tum(tmp_path / "t.tum", np.array([2.5]), np.array([[1.0, 2.0, np.pi / 2]]))
    (line,) = [row for row in (tmp_path / "t.tum").read_text().splitlines() if row[0] != "#"]
    numbers = [float(word) for word in line.split()]
    assert numbers == pytest.approx([2.5, 1, 2, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])


def test_a_trajectory_in_space_is_seen_from_above(tmp_path):
    # One radian to the left, then the nose 0.3 rad up: q = q_yaw * q_pitch, of half the angles.
    yaw, pitch = 0.5, -0.15
    qx, qy = -np.sin(yaw) * np.sin(pitch), np.cos(yaw) * np.sin(pitch)
    qz, qw = np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch)
    (tmp_path / "t.tum").write_text(f"# from elsewhere\n\n0 1 2 9 {qx} {qy} {qz} {qw}\n")
    stamps, poses = read_tum(tmp_path / "t.tum")
    np.testing.assert_allclose(stamps, [0.0])
    np.testing.assert_allclose(poses, [[1, 2, 1.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("0 1 2", "line 3: 3 fields, not 8: 0 1 2"),
        ("0 1 two 0 0 0 0 1", "line 3: 'two' is not a number"),
        ("0 1 nan 0 0 0 0 1", "line 3: nan is not finite"),
        ("0 1 2 0 0 0 0 0.5", "line 3: the quaternion 0 0 0 0.5 has length 0.5, not 1"),
    ],
)
def test_a_bad_line_is_named_with_its_value(tmp_path, line, reason):
    path = tmp_path / "t.tum"
    path.write_text(f"# a comment\n0 1 2 0 0 0 0 1\n{line}\n")
    with pytest.raises(TrajectoryError) as error:
        read_tum(path)
    assert str(error.value) == f"{path}: {reason}"


def test_files_without_a_pose(tmp_path):
    with pytest.raises(TrajectoryError, match="No such file"):
        read_tum(tmp_path / "absent.tum")
    (tmp_path / "empty.tum").write_text("# only\n")
    with pytest.raises(TrajectoryError, match="no pose in 1 lines"):
        read_tum(tmp_path / "empty.tum")


@pytest.mark.parametrize(
    ("stamps", "poses", "message"),
    [
        (STAMPS[:2], POSES, r"poses: shape \(3, 3\) is not \(2, 3\)"),
        (POSES, POSES, r"stamps: shape \(3, 3\) is not \(3,\)"),
        (STAMPS, np.where(POSES == 1.5, -np.inf, POSES), r"poses\[1, 0\]: -inf is not finite"),
        (STAMPS * np.nan, POSES, r"stamps\[0\]: nan is not finite"),
    ],
)
def test_what_cannot_be_written_is_named_and_nothing_written(tmp_path, stamps, poses, message):
    with pytest.raises(ValueError, match=message):
        write_tum(tmp_path / "t.tum", stamps, poses)
    assert not list(tmp_path.iterdir())
