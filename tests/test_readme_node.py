"""The ROS 2 node in the README is Python; nothing more can be said of it without ROS."""

import ast
import re
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"


def node() -> str:
    blocks = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.MULTILINE | re.DOTALL)
    found = [block for block in blocks if re.search(r"^import rclpy$", block, re.MULTILINE)]
    assert len(found) == 1, f"{len(found)} Python blocks of the README import rclpy"
    return found[0]


def test_the_node_compiles_and_is_short():
    source = node()
    compile(source, "README.md", "exec")
    assert len([line for line in source.splitlines() if line.strip()]) <= 40
    assert max(map(len, source.splitlines())) <= 100


def test_the_node_uses_public_names_of_the_package_and_the_three_messages():
    import aprjax

    tree = ast.parse(node())
    used = {
        each.attr
        for each in ast.walk(tree)
        if isinstance(each, ast.Attribute)
        and isinstance(each.value, ast.Name)
        and each.value.id == "aprjax"
    }
    assert used
    assert all(hasattr(aprjax, name) for name in used)
    names = {each.id for each in ast.walk(tree) if isinstance(each, ast.Name)}
    assert {"LaserScan", "PoseWithCovarianceStamped", "PoseArray"} <= names
