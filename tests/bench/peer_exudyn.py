"""One run of exudyn 1.13.6, in its own environment: python peer_exudyn.py SCENE SIZE STEPS NEWTON OUTPUT.

SCENE is cable (ANCF Cable2D), frame (floating frame of reference with Hermite functions), chain (rigid 2D bodies) or the name of
one with stops, SIZE its elements or links, NEWTON full or modified. Prints the seconds that the solver alone took of the
processor; OUTPUT receives time and mid-rod deflection (with stops: position, velocity and angle of the end), one row a step.
"""

import math
import sys
import time

import exudyn as exu
import numpy as np
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import (
    CoordinateConstraint,
    CoordinateSpringDamperExt,
    DistanceConstraint,
    Force,
    GenericJoint,
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    MarkerNodeRigid,
    MarkerSuperElementPosition,
    NodeGenericData,
    NodePoint2DSlope1,
    NodePointGround,
    NodeRigidBody2D,
    ObjectANCFCable2D,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectJointSpherical,
    ObjectRigidBody2D,
    SensorBody,
    SensorNode,
    SensorSuperElement,
)
from peer_scene import AREA, CRANK, DENSITY, END, FORCE, INERTIA, LENGTH, LINK, STIFFNESS, STOPS, YOUNG, crank_end, rod_angle


def crank(mbs, end):
    """The massless crank from the origin to the marker `end`, and the force there; the ground's marker."""
    ground = mbs.AddObject(ObjectGround())
    pivot = mbs.AddMarker(MarkerBodyPosition(bodyNumber=ground, localPosition=[0, 0, 0]))
    mbs.AddObject(DistanceConstraint(markerNumbers=[pivot, end], distance=CRANK))
    mbs.AddLoad(Force(markerNumber=end, loadVector=[*FORCE, 0]))
    return pivot


def cable(mbs, elements):
    """The rod of ANCF cable elements; returns a function that gives times and deflections after the run."""
    angle = rod_angle()
    c, s = math.cos(angle), math.sin(angle)
    first = np.array(crank_end())
    nodes = []
    for k in range(elements + 1):
        x = first + k * LENGTH / elements * np.array([c, s])
        nodes.append(mbs.AddNode(NodePoint2DSlope1(referenceCoordinates=[x[0], x[1], c, s])))
    for k in range(elements):
        mbs.AddObject(
            ObjectANCFCable2D(
                physicsLength=LENGTH / elements,
                physicsMassPerLength=DENSITY * AREA,
                physicsBendingStiffness=YOUNG * INERTIA,
                physicsAxialStiffness=YOUNG * AREA,
                nodeNumbers=nodes[k : k + 2],
                useReducedOrderIntegration=True,
            )
        )
    crank(mbs, mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[0])))
    fixed = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    slider = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[-1], coordinate=1))
    mbs.AddObject(CoordinateConstraint(markerNumbers=[fixed, slider]))
    kind = exu.OutputVariableType.Position
    sensors = [
        mbs.AddSensor(SensorNode(nodeNumber=n, storeInternal=True, outputVariableType=kind))
        for n in (nodes[0], nodes[elements // 2], nodes[-1])
    ]

    def deflection():
        a, m, b = (mbs.GetSensorStoredData(k) for k in sensors)
        chord = b[:, 1:3] - a[:, 1:3]
        mid = m[:, 1:3] - a[:, 1:3]
        return a[:, 0], (chord[:, 0] * mid[:, 1] - chord[:, 1] * mid[:, 0]) / np.linalg.norm(chord, axis=1)

    return deflection


def lobatto(elements):
    """Five Gauss-Lobatto points an element along the rod, in elements, and their masses [kg]: exact up to degree 7."""
    inner = math.sqrt(3 / 7) / 2
    places, weights = np.zeros(4 * elements + 1), np.zeros(4 * elements + 1)
    for e in range(elements):
        places[4 * e : 4 * e + 5] = e + np.array([0, 0.5 - inner, 0.5, 0.5 + inner, 1])
        weights[4 * e : 4 * e + 5] += np.array([1 / 20, 49 / 180, 16 / 45, 49 / 180, 1 / 20]) / elements
    return places, DENSITY * AREA * LENGTH * weights


def hermite(elements, places):
    """Displacements (3 a place) for each coordinate of a pinned beam, and its stiffness.

    Coordinates: rotation of the first node, (u, v, rotation) of inner nodes, u and rotation of the last one.
    """
    h = LENGTH / elements
    n = 3 * (elements + 1)
    psi = np.zeros((3 * len(places), n))
    stiff = np.zeros((n, n))
    rows = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]]
    rows += [[-x for x in rows[0]], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    bending = YOUNG * INERTIA / h**3 * np.array(rows)
    for e in range(elements):
        b = [3 * e + 1, 3 * e + 2, 3 * e + 4, 3 * e + 5]
        stiff[np.ix_(b, b)] += bending
        a = [3 * e, 3 * e + 3]
        stiff[np.ix_(a, a)] += YOUNG * AREA / h * np.array([[1, -1], [-1, 1]])
    for k, x in enumerate(places):
        e = min(int(x), elements - 1)
        t = x - e
        psi[3 * k, [3 * e, 3 * e + 3]] = 1 - t, t
        psi[3 * k + 1, [3 * e + 1, 3 * e + 2, 3 * e + 4, 3 * e + 5]] = (
            1 - 3 * t**2 + 2 * t**3,
            h * (t - 2 * t**2 + t**3),
            3 * t**2 - 2 * t**3,
            h * (t**3 - t**2),
        )
    kept = [k for k in range(n) if k not in (0, 1, n - 2)]
    return psi[:, kept], stiff[np.ix_(kept, kept)]


def frame(mbs, elements):
    """The rod as a floating frame with the Hermite functions of so many elements, its integrals exact."""
    places, masses = lobatto(elements)
    points = len(places)
    psi, stiff = hermite(elements, places)
    fem = FEMinterface()
    fem.nodes = {"Position": np.column_stack([places * LENGTH / elements, np.zeros(points), np.zeros(points)])}
    fem.massMatrix = np.diag(np.repeat(masses, 3))
    fem.stiffnessMatrix = 0 * fem.massMatrix
    fem.modeBasis = {"matrix": psi, "type": "NormalModes"}
    cms = ObjectFFRFreducedOrderInterface(fem)
    cms.stiffnessMatrixReduced = stiff
    angle = rod_angle()
    c, s = math.cos(angle), math.sin(angle)
    made = cms.AddObjectFFRFreducedOrder(
        mbs,
        positionRef=[*crank_end(), 0],
        initialVelocity=[0, 0, 0],
        rotationMatrixRef=np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        initialAngularVelocity=[0, 0, 0],
    )
    origin = mbs.AddMarker(MarkerNodeRigid(nodeNumber=made["nRigidBody"]))
    fixed = crank(mbs, origin)
    frame_ground = mbs.AddMarker(MarkerBodyRigid(bodyNumber=mbs.AddObject(ObjectGround()), localPosition=[0, 0, 0]))
    mbs.AddObject(GenericJoint(markerNumbers=[frame_ground, origin], constrainedAxes=[0, 0, 1, 1, 1, 0]))
    rod = made["oFFRFreducedOrder"]
    end = mbs.AddMarker(MarkerSuperElementPosition(bodyNumber=rod, meshNodeNumbers=[points - 1], weightingFactors=[1.0]))
    mbs.AddObject(ObjectJointSpherical(markerNumbers=[fixed, end], constrainedAxes=[0, 1, 0]))
    sensor = mbs.AddSensor(
        SensorSuperElement(
            bodyNumber=rod,
            meshNodeNumber=points // 2,
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.DisplacementLocal,
        )
    )

    def deflection():
        data = mbs.GetSensorStoredData(sensor)
        return data[:, 0], data[:, 2]

    return deflection


def chain(mbs, links, limit=0.0):
    """A pendulum of rigid links let go from the horizontal, with a stop in each joint where a limit is given."""
    ground = mbs.AddObject(ObjectGround())
    before = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    far = mbs.AddMarker(MarkerBodyPosition(bodyNumber=ground, localPosition=[0, 0, 0]))
    for k in range(links):
        node = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[(k + 0.5) * LINK, 0, 0]))
        body = mbs.AddObject(ObjectRigidBody2D(physicsMass=1.0, physicsInertia=LINK**2 / 12, nodeNumber=node))
        near = mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[-LINK / 2, 0, 0]))
        mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[far, near]))
        mbs.AddLoad(LoadMassProportional(markerNumber=mbs.AddMarker(MarkerBodyMass(bodyNumber=body)), loadVector=[0, -9.81, 0]))
        far = mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[LINK / 2, 0, 0]))
        if limit:
            turn = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=2))
            state = mbs.AddNode(NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0, 0, 0]))
            mbs.AddObject(
                CoordinateSpringDamperExt(
                    markerNumbers=[before, turn],
                    nodeNumber=state,
                    useLimitStops=True,
                    limitStopsUpper=limit,
                    limitStopsLower=-limit,
                    limitStopsStiffness=STIFFNESS,
                )
            )
            before = turn
    if not limit:
        return lambda: (np.zeros(1), np.zeros(1))
    kinds = exu.OutputVariableType
    end = {"bodyNumber": body, "localPosition": [LINK / 2, 0, 0], "storeInternal": True}
    sensors = [mbs.AddSensor(SensorBody(**end, outputVariableType=kind)) for kind in (kinds.Position, kinds.Velocity)]
    sensors.append(mbs.AddSensor(SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kinds.Coordinates)))

    def motion():
        place, speed, angle = (mbs.GetSensorStoredData(k) for k in sensors)
        return place[:, 0], np.column_stack([place[:, 1:3], speed[:, 1:3], angle[:, 3]])

    return motion


def main():
    """Builds, solves, prints the seconds of the solver alone."""
    scene, size, steps, newton, output = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], sys.argv[5]
    end = END if scene != "chain" else 1.0e-4 * steps
    limit = 0.0
    if scene in STOPS:
        size, limit, end = STOPS[scene]
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    result = chain(mbs, size, limit) if limit else {"cable": cable, "frame": frame, "chain": chain}[scene](mbs, size)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = end
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = newton == "modified"
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = end / steps
    if scene == "chain" or size > 8:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    start = time.process_time()
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
    seconds = time.process_time() - start
    times, values = result()
    np.savetxt(output, np.column_stack([times, values]))
    print(f"seconds {seconds:.6e}")


if __name__ == "__main__":
    main()
