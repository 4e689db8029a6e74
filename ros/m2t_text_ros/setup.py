from pathlib import Path

from setuptools import setup

NAME = "m2t_text_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", [str(file) for file in Path("launch").glob("*.py")]),
        (f"share/{NAME}/config", [str(file) for file in Path("config").glob("*.yaml")]),
        (f"share/{NAME}/rviz", [str(file) for file in Path("rviz").glob("*.rviz")]),
    ],
    install_requires=["setuptools"],  # and m2t-text, which a distribution of ROS does not have: see the README
    zip_safe=True,
    maintainer="The m2t-text developers",
    maintainer_email="m2t-text@example.org",
    description="Finds a robot with a 2D laser in a saved map, without an initial pose.",
    license="MIT",
    entry_points={"console_scripts": [f"localizer = {NAME}.node:main"]},
)
