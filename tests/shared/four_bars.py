"""Rows of four-bars that pass positions in which all links lie in a line (IFToMM A02), and their exact reduction."""

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81


def row_of_four_bars(n, speed=1.0):
    """Return N four-bars in a row (IFToMM A02): all links collinear twice a turn, N rows dependent there."""
    deck = "&scene gravity=0.0,-9.81 /\n"
    for k in range(n + 1):
        spin = f"angular_velocity={-speed}" if k == 0 else ""
        deck += (
            f"&body name='v{k}' kind='rigid' mass=1.0 inertia={1 / 12} com=0.5,0.0 position={k}.0,0.0 angle={np.pi / 2} {spin} /\n"
        )
        deck += f"&joint name='g{k}' type='revolute' body_a='v{k}' point_b={k}.0,0.0 /\n"
    for k in range(n):
        deck += f"&body name='h{k}' kind='rigid' mass=1.0 inertia={1 / 12} com=0.5,0.0 position={k}.0,1.0 /\n"
        deck += f"&joint name='l{k}' type='revolute' body_a='h{k}' body_b='v{k}' point_b=1.0,0.0 /\n"
        deck += f"&joint name='r{k}' type='revolute' body_a='h{k}' point_a=1.0,0.0 body_b='v{k + 1}' point_b=1.0,0.0 /\n"
    return deck + "&sensor name='b' quantity='position' body='v0' point=1.0,0.0 /\n"


def four_bars(count, phi=0.0, rate=1.0, t_end=10.0, step=1e-3, output=0.1):
    """Return the deck of N four-bars in a row at the angle phi from the vertical, B0 moving clockwise."""
    angle, x, y = np.pi / 2 - phi, np.sin(phi), np.cos(phi)
    lines = [f"&scene gravity=0.0,{-GRAVITY} /"]
    link = "kind='rigid' mass=1.0 inertia=0.08333333333333333 com=0.5,0.0"
    for k in range(count + 1):
        spin = f"angular_velocity={-rate:.17g}" if k == 0 else ""
        lines.append(f"&body name='v{k}' {link} position={float(k)},0.0 angle={angle:.17g} {spin} /")
        lines.append(f"&joint name='ground{k}' type='revolute' body_a='v{k}' point_b={float(k)},0.0 /")
    for k in range(count):
        lines.append(f"&body name='h{k}' {link} position={k + x:.17g},{y:.17g} /")
        lines.append(f"&joint name='left{k}' type='revolute' body_a='h{k}' body_b='v{k}' point_b=1.0,0.0 /")
        lines.append(f"&joint name='right{k}' type='revolute' body_a='h{k}' point_a=1.0,0.0 body_b='v{k + 1}' point_b=1.0,0.0 /")
    lines += [
        "&sensor name='b0' quantity='position' body='v0' point=1.0,0.0 /",
        "&sensor name='vb0' quantity='velocity' body='v0' point=1.0,0.0 /",
        f"&transient t_end={t_end:.17g} method='rk4' step={step:.17g} output_step={output:.17g} /",
    ]
    return "\n".join(lines) + "\n"


def reduced_four_bars(count, times, phi=0.0, rate=1.0):
    """Return phi, phi' (2, times) of the exact reduction I phi'^2/2 + g H cos phi = const."""
    inertia, height = (count + 1) / 3 + count, (count + 1) / 2 + count

    def slope(_, y):
        return [y[1], GRAVITY * height / inertia * np.sin(y[0])]

    return solve_ivp(slope, (0.0, times[-1]), [phi, rate], "DOP853", t_eval=times, rtol=1e-13, atol=1e-13).y
