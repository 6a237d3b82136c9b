"""An arm of two segments that its outer chambers bend short: little stiffness against bending."""

from soro_core.robot import Robot, robot_from_dict


def collapsing_arm(**changes) -> Robot:
    """Chamber 0 at 204 kPa collapses link0; up to 110 kPa it does not. `changes` are keys of each link."""
    links = []
    for length, k_e, k_b, damping, bends, lengthens in (
        (0.1449, 1040.0, 0.575, [0.15, 5.0e-4, 5.0e-4], 9.27e-7, 5.79e-5),
        (0.1356, 3670.0, 1.021, [0.2, 2.0e-4, 2.0e-4], 8.67e-7, 5.42e-5),
    ):
        chambers = [
            {"angle_rad": 3.141592653589793, "alpha_eps": 0.0, "alpha_kappa": bends},
            {"angle_rad": 0.0, "alpha_eps": 0.0, "alpha_kappa": bends},
            {"angle_rad": 0.0, "alpha_eps": lengthens, "alpha_kappa": 0.0},
        ]
        link = {"length": length, "radius": 0.05, "mass": 0.293, "damping": damping, "chambers": chambers}
        links.append({**link, "k_e": [k_e, 0.0, 0.0], "k_b": [k_b, 0.0, 0.0], **changes})
    return robot_from_dict(
        {"base_quaternion": [1.0, 0.0, 0.0, 0.0], "pressure_range_pa": [0.0, 110e3], "links": links}
    )
