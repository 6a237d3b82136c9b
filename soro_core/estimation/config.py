"""Parameters of the estimator."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict
from soro_core.estimation.force.config import ForceConfig
from soro_core.estimation.sensors.watch_config import WatchConfig
from soro_core.robot.discretisation import Integrator


class PoseNoise(Strict):
    """Noise of pose samples."""

    position_std_m: float = Field(3e-4, gt=0, le=1, description="sensor noise of each coordinate")
    orientation_std_rad: float = Field(6e-3, gt=0, le=3, description="sensor noise of each rotation")
    position_model_std_m: float = Field(
        0.0,
        ge=0,
        le=1,
        description="error of the arm's kinematics in position, beyond the sensor's; a link that stretches "
        "and bends reaches every position of its tip",
    )
    orientation_model_std_rad: float = Field(
        0.2,
        ge=0,
        le=3,
        description="error of the arm's kinematics in orientation; a load bends a link non-uniformly, and "
        "constant curvature can then match the position of the tip or its orientation, not both",
    )
    max_age_s: float = Field(0.08, gt=0, le=2, description="older samples are stale")


class ImuNoise(Strict):
    """Noise of IMU samples."""

    rate_std_rad_s: float = Field(0.02, gt=0, le=10, description="noise of the angular velocity")
    orientation_std_rad: float = Field(
        0.02, gt=0, le=3, description="noise of the orientation, where it has one"
    )
    orientation_model_std_rad: float = Field(0.2, ge=0, le=3, description="error of the arm's kinematics")
    acceleration_std_m_s2: float = Field(
        1.5, gt=0, le=100, description="noise of the direction of gravity, the motion of the arm included"
    )
    use_gravity: bool = Field(True, description="use the acceleration as the direction of gravity")
    gravity_tolerance_m_s2: float = Field(
        2.0, gt=0, le=100, description="accelerations whose length is farther from gravity are not used"
    )
    max_age_s: float = Field(0.08, gt=0, le=2, description="older samples are stale")


class ProcessNoise(Strict):
    """Errors of the model; stretch: elongation and shears, curvature: bending and torsion."""

    stretch_acceleration: float = Field(
        2.0, ge=0, le=1e9, description="spectral density of the acceleration's error, strain/s^2/sqrt(Hz)"
    )
    curvature_acceleration_per_m: float = Field(
        40.0, ge=0, le=1e9, description="the same of curvatures, 1/(m s^2)/sqrt(Hz)"
    )
    stretch_disturbance: float = Field(
        1e4,
        ge=0,
        le=1e9,
        description="spectral density of the second derivative of the disturbance, which is an acceleration: "
        "strain/s^4/sqrt(Hz)",
    )
    curvature_disturbance_per_m: float = Field(
        2e4, ge=0, le=1e9, description="the same of curvatures, 1/(m s^4)/sqrt(Hz)"
    )
    disturbance_time_s: float = Field(
        5.0, gt=0, le=1e4, description="time constant with which a disturbance that no sample observes decays"
    )


class LearnedProcessNoise(ProcessNoise):
    """The same where a learned force is part of the model: less is left for noise to explain."""

    stretch_acceleration: float = Field(
        0.0, ge=0, le=1e9, description="spectral density of the acceleration's error of elongation and shears"
    )
    curvature_acceleration_per_m: float = Field(0.0, ge=0, le=1e9, description="the same of curvatures")
    stretch_disturbance: float = Field(
        170.0,
        ge=0,
        le=1e9,
        description="the same of the second derivative of the disturbance of elongation and shears",
    )
    curvature_disturbance_per_m: float = Field(500.0, ge=0, le=1e9, description="the same of curvatures")
    disturbance_time_s: float = Field(
        0.8,
        gt=0,
        le=1e4,
        description="time constant with which a disturbance decays: what lasts longer is learned",
    )


class InitialNoise(Strict):
    """Uncertainty of the state at the start and after re-acquisition."""

    stretch_std: float = Field(0.1, gt=0, le=10, description="elongation and shears, strain")
    curvature_std_per_m: float = Field(8.0, gt=0, le=1e3, description="curvatures")
    stretch_rate_std_per_s: float = Field(1.0, gt=0, le=1e4, description="rate of elongation and shears")
    curvature_rate_std_per_m_s: float = Field(80.0, gt=0, le=1e5, description="rate of curvatures")
    stretch_disturbance_std: float = Field(300.0, ge=0, le=1e9, description="disturbance, strain/s^2")
    curvature_disturbance_std_per_m: float = Field(
        3e3, ge=0, le=1e9, description="the same of curvatures, 1/(m s^2)"
    )


class EstimatorConfig(Strict):
    """Parameters of the extended Kalman filter; the defaults are tuned for the three-bellow robot."""

    scale_noise: bool = Field(
        True,
        description="scale process, initial and orientation model noise that has its default from the "
        "three-bellow arm, which it is tuned for, to the model of this one; docs/gains.md",
    )
    disturbance: bool = Field(
        True, description="estimate a slowly varying generalised force beside q and qd (unknown payload)"
    )
    process: ProcessNoise = Field(ProcessNoise(), description="process noise")
    learned_process: LearnedProcessNoise = Field(
        LearnedProcessNoise(), description="process noise while a learned force is in force"
    )
    initial: InitialNoise = Field(InitialNoise(), description="initial uncertainty")
    pressure_std_pa: float = Field(
        100.0,
        ge=0,
        le=1e9,
        description="noise of each measured pressure, independent from reading to reading; of the platform",
    )
    pose: PoseNoise = Field(PoseNoise(), description="pose samples")
    imu: ImuNoise = Field(ImuNoise(), description="IMU samples")
    integrator: Integrator = Field(
        "trapezoidal",
        description="no effect any more, read for old files: the filter has a step of its own "
        "(docs/estimation.md)",
    )
    watch: WatchConfig = Field(
        WatchConfig(), description="noise of the sensors, and from when on a residual is named"
    )
    force: ForceConfig = Field(ForceConfig(), description="external force at the tip")
    gate_probability: float = Field(
        0.9999, gt=0.5, lt=1, description="share of good samples that pass the chi-square gate"
    )
    outlier_inflation: float = Field(
        4.0,
        ge=1,
        le=10,
        description="factor on the covariance for every refused sample: one outlier costs little, and the "
        "filter follows a motion that the model does not predict within a few samples",
    )
    reacquire_after: int = Field(
        15,
        ge=1,
        le=10000,
        description="consecutive outliers of one sensor after which the state is re-acquired",
    )
    history_s: float = Field(
        0.15, gt=0, le=5, description="how far the filter can roll back for a late sample"
    )
    future_s: float = Field(
        0.05,
        ge=0,
        le=1,
        description="samples stamped up to this far ahead wait; samples farther ahead are refused",
    )
    lost_after_s: float = Field(
        0.25, gt=0, le=60, description="time without a good sample after which the status is not ok"
    )
    max_step_s: float = Field(0.01, gt=0, le=0.1, description="longest step of the prediction")
    max_gap_s: float = Field(0.5, gt=0, le=10, description="longer gaps between two steps restart the filter")
    stretch_limit: float = Field(0.8, gt=0, lt=1, description="largest elongation or shear of an estimate")
    bend_limit_rad: float = Field(
        6.0, gt=0, le=30, description="largest bending or torsion of a link of an estimate"
    )
