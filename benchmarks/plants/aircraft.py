"""Aircraft: a fighter, a business jet and an airliner in pitch, airliners sideways, a jet that stands on its thrust."""

from __future__ import annotations

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['airliner, output', 'business jet, output', 'fighter', 'jumbo jet, output', 'pitch, output', 'vectored thrust']
    """
    return {"fighter": fighter(), "business jet, output": business_jet(), "pitch, output": pitch(),
            "jumbo jet, output": jumbo_jet(), "vectored thrust": vectored_thrust(), "airliner, output": airliner()}


def fighter() -> Case:
    """Return the AFTI F-16 in pitch: speed (ft/s), angle of attack, pitch rate, pitch angle (deg); held over 0.05 s.

    Elevator and flaperon are limited to 25 deg each; unstable, with an eigenvalue of 1.31 per step. The state is measured.
    Weights and box are chosen here.

    >>> fighter().plant.B.shape
    (4, 2)
    """
    A = [[-0.0151, -60.5651, 0.0, -32.174], [-0.0001, -1.3411, 0.9929, 0.0], [0.00018, 43.2541, -0.86939, 0.0],
         [0.0, 0.0, 1.0, 0.0]]
    B = [[-2.516, -13.136], [-0.1689, -0.2514], [-17.251, -1.5766], [0.0, 0.0]]
    half = np.array([10.0, 1.0, 1.5, 6.0])
    spec = Spec(np.diag([1e-4, 10.0, 1e-2, 10.0]), np.diag([0.1, 0.1]), 0.98, Box(-half, half), Box([-25, -25], [25, 25]))
    return Case(Plant(A, B, dt=0.0).sampled(0.05), spec, "Kapasouris, Athans, Stein, IFAC NOLCOS 1989; Bemporad, Casavola, "
                "Mosca, IEEE TAC 42(3), 1997")


def business_jet() -> Case:
    """Return a Cessna Citation 500 in pitch: angle of attack, pitch (rad), pitch rate (rad/s), height (m); held 0.5 s.

    Elevator |u| <= 0.262 rad (15 deg). Pitch, height and climb rate (m/s) are measured and weighed alike, as in the source,
    which weighs the input by 1 against them; 1000 here, so that rad count beside m. Two eigenvalues are 1. Box chosen here.

    >>> business_jet().plant.p
    3
    """
    A = [[-1.2822, 0.0, 0.98, 0.0], [0.0, 0.0, 1.0, 0.0], [-5.4293, 0.0, -1.8366, 0.0], [-128.2, 128.2, 0.0, 0.0]]
    C = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-128.2, 128.2, 0.0, 0.0]])
    half = np.array([0.1, 0.25, 0.1, 40.0])
    spec = Spec(C.T @ C, 1000.0, 0.98, Box(-half, half), Box(-0.262, 0.262))
    return Case(Plant(A, [[-0.3], [0.0], [-17.0], [0.0]], C, dt=0.0).sampled(0.5), spec,
                "Maciejowski, Predictive Control with Constraints, 2002, p. 64")


def pitch() -> Case:
    """Return an airliner in pitch: angle of attack (rad), pitch rate, pitch (rad), which is measured; held over 0.2 s.

    Elevator |u| <= 0.4363 rad (25 deg). The rate is in units of 56.7 rad/s as printed; one eigenvalue is 1. The weight 50 on
    pitch is the source's, against 1 on the elevator; box chosen here.

    >>> pitch().plant.p
    1
    """
    plant = Plant([[-0.313, 56.7, 0.0], [-0.0139, -0.426, 0.0], [0.0, 56.7, 0.0]], [[0.232], [0.0203], [0.0]],
                  [[0.0, 0.0, 1.0]], dt=0.0).sampled(0.2)
    half = np.array([0.05, 0.001, 0.15])
    spec = Spec(np.diag([0.0, 0.0, 50.0]), 1.0, 0.98, Box(-half, half), Box(-0.4363, 0.4363))
    return Case(plant, spec, "Control Tutorials for MATLAB and Simulink, Michigan and Carnegie Mellon, aircraft pitch")


def jumbo_jet() -> Case:
    """Return a Boeing 747 in cruise: sideslip (rad), yaw rate, roll rate (rad/s), bank (rad); held over 0.2 s.

    Rudder and aileron (rad) are limited to 0.2 and 0.35; yaw rate and bank are measured. The Dutch roll is hardly damped.
    Limits, weights and box are chosen here.

    >>> jumbo_jet().plant.m
    2
    """
    A = [[-0.0558, -0.9968, 0.0802, 0.0415], [0.598, -0.115, -0.0318, 0.0], [-3.05, 0.388, -0.465, 0.0],
         [0.0, 0.0805, 1.0, 0.0]]
    B = [[0.00729, 0.0], [-0.475, 0.00775], [0.153, 0.143], [0.0, 0.0]]
    C = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    half = np.array([0.05, 0.05, 0.1, 0.3])
    spec = Spec(np.diag([1.0, 10.0, 1.0, 2.0]), np.eye(2), 0.98, Box(-half, half), Box([-0.2, -0.35], [0.2, 0.35]))
    return Case(Plant(A, B, C, dt=0.0).sampled(0.2), spec, "The MathWorks, Control System Toolbox, yaw damper for a 747")


def vectored_thrust() -> Case:
    """Return a jet that stands on its thrust: place and height (m), pitch (rad), their rates; held over 0.1 s.

    4 kg, 0.0475 kg m^2, thrust 0.25 m below the centre, damping 0.05 N s/m, g = 9.8 m/s^2. The forces across and along the
    body differ by at most 2 and 10 N from those of hovering; the place goes the wrong way first. Limits, weights and box are
    chosen here.

    >>> vectored_thrust().plant.n
    6
    """
    m, J, arm, damping, g = 4.0, 0.0475, 0.25, 0.05, 9.8
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 2], A[3, 3], A[4, 4] = -g, -damping / m, -damping / m
    B = np.zeros((6, 2))
    B[3, 0], B[4, 1], B[5, 0] = 1 / m, 1 / m, arm / J
    half, limit = np.array([1.0, 1.0, 0.1, 0.5, 0.5, 0.5]), np.array([2.0, 10.0])
    spec = Spec(np.diag([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]), np.diag([0.1, 0.01]), 0.98, Box(-half, half), Box(-limit, limit))
    return Case(Plant(A, B, dt=0.0).sampled(0.1), spec,
                "Åström, Murray, Feedback Systems, 2008, the vectored thrust aircraft")


def airliner() -> Case:
    """Return a Lockheed L-1011 in cruise: rudder, aileron (rad), bank (rad), yaw, roll rate (rad/s), sideslip, washout.

    The commands of rudder and aileron (rad) are limited to 0.3, their servos are lags of 20 and 25 /s; washed-out yaw rate,
    roll rate, sideslip and bank are measured; held over 0.1 s. Limits, weights and box are chosen here.

    >>> airliner().plant.n, airliner().plant.p
    (7, 4)
    """
    A = [[-20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, -25.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
         [-0.744, -0.032, 0.0, -0.154, -0.0042, 1.54, 0.0], [0.337, -1.12, 0.0, 0.249, -1.0, -5.2, 0.0],
         [0.02, 0.0, 0.0386, -0.996, -0.0003, -0.117, 0.0], [0.0, 0.0, 0.0, 0.5, 0.0, 0.0, -0.5]]
    B = np.zeros((7, 2))
    B[0, 0], B[1, 1] = 20.0, 25.0
    C = np.zeros((4, 7))
    C[0, 3], C[0, 6], C[1, 4], C[2, 5], C[3, 2] = 1.0, -1.0, 1.0, 1.0, 1.0
    half, limit = np.array([0.1, 0.1, 0.3, 0.05, 0.1, 0.05, 0.05]), np.array([0.3, 0.3])
    spec = Spec(np.diag([0.0, 0.0, 2.0, 10.0, 1.0, 1.0, 0.0]), np.eye(2), 0.98, Box(-half, half), Box(-limit, limit))
    return Case(Plant(A, B, C, dt=0.0).sampled(0.1), spec, "Andry, Shapiro, Chung, IEEE TAES 19(5), 1983, the L-1011")
