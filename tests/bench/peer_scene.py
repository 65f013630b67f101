"""The scene that both programs solve: a slider-crank with massless crank and slider, a constant force on the crank's end."""

import math

LENGTH, DENSITY, YOUNG, AREA, INERTIA = 0.3492, 1600.0, 2.1e10, 1.6129e-4, 8.6576e-9  # the rod [m, kg/m3, Pa, m2, m4]
CRANK = 0.1524  # [m]
START = math.pi / 6  # the crank's angle [rad]
FORCE = (-30.0, 50.0)  # on the crank's end [N]
END = 0.01  # [s]
LINK = 0.1  # of the chain [m]
STIFFNESS = 200.0  # of a stop [Nm/rad]
STOPS = {"arm on a stop": (1, 0.5, 1.0), "chain of 20 stops": (20, 0.15, 0.3)}  # links, limits of their angles [rad], end [s]


def crank_end():
    """Where the crank ends and the rod begins [m]."""
    return CRANK * math.cos(START), CRANK * math.sin(START)


def rod_angle():
    """Angle of the rod whose end lies on y = 0 [rad]."""
    return -math.asin(CRANK * math.sin(START) / LENGTH)
