"""The actuators and sensors in a simulated cell other than the arm: the hand or cup, the belts and the
switches.
"""

from libc.math cimport fabs
from libc.stdint cimport uintptr_t

import numpy as np

from cobot.arrays cimport doubles
from cobot.robot.mujoco cimport data_of, mj_jacDot, mj_ray, model_of

from cobot.cell import TurningHand
from cobot.cell.cell import COUNT, CUP, SPEED, ContactSwitch, LightBarrier
from cobot.cell.plant_hands import DRIVE_KG, FINGERS, LIPS, drive_inertia
from rtloop.backends.cell_points import HAND_POINTS, cell_points
from rtloop.backends.protocols import BackendError

# Indices of the hand's points, see `cell_points`.
cdef enum:
    WIDTH
    FINGER_SPEED
    FORCE
    MEASURED_WIDTH
    MEASURED_FORCE
    MOVING

# Indices of a cup's points. A cell has either a hand or a cup.
cdef enum:
    SUCTION
    VACUUM

cdef enum:
    LIGHT_BARRIER
    CONTACT
    DISTANCE

# The drives of the fingers follow the width like springs of this frequency, critically damped.
cdef double FINGER_FREQUENCY_RAD_S = 150.0
cdef double DRIVE_MASS = DRIVE_KG
# The fingers are at rest if the width changes more slowly than this, or is closer to the goal than this.
cdef double STILL_M_S = 0.001
cdef double REACHED_M = 0.0002
# Time without motion after which the fingers are at rest.
cdef double REST_S = 0.05
# A cup that is not covered reaches only this share of its vacuum, because air flows in. The time constant is
# for the loss of the vacuum.
cdef double OPEN_SHARE = 0.1
cdef double OPEN_S = 0.01


cdef class CellDevices:
    """The hand or the cup, the belts and the switches of a plant, and their inputs and outputs. Methods with
    the prefix `c_` run in the cycle.
    """

    def __init__(self, plant, data, double period_s):
        cell = plant.cell
        self._owners = plant, data
        self._model, self._data = <mjModel*>model_of(plant.mj), data_of(data)
        self._points = cell_points(cell, plant.hand)
        if len(self._points) > MAX_POINTS:
            raise BackendError(
                f"the cell has {len(self._points)} inputs and outputs, at most {MAX_POINTS} are allowed"
            )
        self._indices = {point.name: index for index, point in enumerate(self._points)}
        self._period_s = period_s
        self._has_hand = plant.hand is not None
        if self._has_hand:
            assert HAND_POINTS == MOVING + 1
            self._add_hand(plant)
            self._cycles_to_rest = round(REST_S / period_s)
        self._gripping_array = np.zeros(plant.mj.nbody, np.uint8)
        self._gripping_array[list(plant.gripping)] = 1
        self._gripping = <unsigned char*><uintptr_t>self._gripping_array.ctypes.data
        self._has_cup = cell.cup is not None
        if self._has_cup:
            assert len(LIPS) == LIP_BALLS
            self._cup = plant.mj.body(CUP).id
            self._lip = plant.mj.geom(LIPS[0]).id
            self._holding_n, self._full_kpa = cell.cup.force_n, cell.cup.vacuum_kpa
            self._lip_m, self._evacuate_s = cell.cup.length_m, cell.cup.evacuate_s
        self._sucked = -1
        self._turning_array = np.zeros((2, 3, plant.mj.nv))
        self._turning = doubles(self._turning_array, 6 * plant.mj.nv)
        self._belts = len(cell.belts)
        for index, name in enumerate(cell.belts):
            self._belt_geom[index] = plant.mj.geom(name).id
            self._belt_point[index] = self._indices[f"{name}.{SPEED}"]
        self._add_switches(plant)
        self.reset()

    cdef _add_hand(self, object plant):
        """Prepare the drives of the hand, and the relation between their positions and the width."""
        hand, model = plant.hand, plant.mj
        turns = isinstance(hand, TurningHand)
        self._stroke_m, self._closed_m = hand.stroke_m, hand.closed_m
        widths = hand.widths_m if turns else (0.0, hand.stroke_m)
        self._last_width = len(widths) - 1
        for index, width in enumerate(widths):
            self._widths[index] = width
        names = FINGERS[:1] if turns else FINGERS
        self._drives = len(names)
        for index, name in enumerate(names):
            self._finger_position[index] = model.joint(name).qposadr[0]
            self._finger_dof[index] = model.joint(name).dofadr[0]
            self._travel[index] = model.joint(name).range[1]
            self._inertia[index] = drive_inertia(hand) if turns else DRIVE_KG
        self._per_travel = 1.0 / sum(model.joint(name).range[1] for name in names)

    cdef _add_switches(self, object plant):
        """Prepare the switches. Their rays are given in the world frame."""
        cdef Switch* made
        base, body_of = plant.base, plant.mj.body
        self._switches = len(plant.cell.switches)
        for index, (name, switch) in enumerate(plant.cell.switches.items()):
            made = &self._switch[index]
            made.point, made.count = self._indices[name], self._indices.get(f"{name}.{COUNT}", -1)
            if isinstance(switch, ContactSwitch):
                made.kind, made.body, made.force = CONTACT, body_of(switch.body).id, switch.force_n
                continue
            origin = np.array(switch.from_m)
            if isinstance(switch, LightBarrier):
                made.kind, way = LIGHT_BARRIER, np.array(switch.to_m) - origin
                made.ray.length_m = np.linalg.norm(way)
            else:
                made.kind, way = DISTANCE, np.array(switch.direction)
                made.ray.length_m = switch.range_m
            start, direction = base.apply(origin), base.rotation @ (way / np.linalg.norm(way))
            for axis in range(3):
                made.ray.origin[axis], made.ray.direction[axis] = start[axis], direction[axis]

    def reset(self):
        """Reset all outputs and counters to their initial values."""
        for index, point in enumerate(self._points):
            self._values[index] = point.first
        self._reported = None
        self._reference = self._stroke_m
        self._still_cycles = self._cycles_to_rest

    def io(self):
        """All inputs and outputs."""
        reported = self._reported
        if reported is None:
            reported = [point.reported(self._values[index]) for index, point in enumerate(self._points)]
        for index, point in enumerate(reported):
            if point.value != self._values[index]:
                reported[index] = self._points[index].reported(self._values[index])
        self._reported = reported
        return tuple(reported)

    def read_input(self, name):
        """The current value of an input or output."""
        return self._values[self._index_of(name)]

    def set_output(self, name, double value):
        """Set an output.

        Raises:
            BackendError: there is no such output, or the value is out of range.
        """
        index = self._index_of(name)
        point = self._points[index]
        if not point.is_output:
            raise BackendError(f"{name} is an input")
        if not point.low <= value <= point.high:
            raise BackendError(f"{name} is {value:g}, allowed: {point.low:g} to {point.high:g}")
        self._values[index] = value
        if self._has_hand and index == WIDTH and fabs(value - self._values[MEASURED_WIDTH]) > REACHED_M:
            self._still_cycles = 0
            self._values[MOVING] = 1.0

    def _index_of(self, name):
        index = self._indices.get(name)
        if index is None:
            raise BackendError(f"the cell has no input or output {name!r}")
        return index

    cdef void c_drive(self) noexcept nogil:
        """Set the forces of the fingers or the cup, and the speeds of the belts, for the next step."""
        cdef int index
        if self._has_hand:
            self._drive_hand()
        if self._has_cup:
            self._suck()
        for index in range(self._belts):
            self._model.geom_surfacevel[6 * self._belt_geom[index]] = self._values[self._belt_point[index]]

    cdef void _drive_hand(self) noexcept nogil:
        """Move the reference of the width to the goal at the speed set by the output. It leads the fingers by
        no more than is needed for the full force.
        """
        cdef double* position = self._data.qpos
        cdef double* velocity = self._data.qvel
        cdef double force = self._values[FORCE]
        cdef double step = self._values[FINGER_SPEED] * self._period_s
        cdef double width = self._width()
        cdef int place = self._step_at(self._opening())
        # The slope of the width at this opening, in m per full opening, and its ratio to the mean slope.
        cdef double slope = (self._widths[place + 1] - self._widths[place]) * self._last_width
        cdef double steeper = slope / (self._stroke_m - self._closed_m)
        cdef double lead = (
            2.0 * (force + 1.0) * steeper * steeper
            / (DRIVE_MASS * FINGER_FREQUENCY_RAD_S * FINGER_FREQUENCY_RAD_S)
        )
        cdef double before = self._reference, speed, pull, opening, limit
        cdef int drive, dof
        self._reference = min(max(self._values[WIDTH], before - step), before + step)
        self._reference = min(max(self._reference, width - lead - step), width + lead + step)
        speed = min(max((self._reference - before) / self._period_s, -self._values[FINGER_SPEED]),
                    self._values[FINGER_SPEED])
        opening = self._opening_at(self._reference)
        limit = force * slope * self._per_travel
        for drive in range(self._drives):
            dof = self._finger_dof[drive]
            pull = self._inertia[drive] * FINGER_FREQUENCY_RAD_S * (
                FINGER_FREQUENCY_RAD_S
                * (self._travel[drive] * opening - position[self._finger_position[drive]])
                + 2.0 * (self._travel[drive] * speed / slope - velocity[dof])
            )
            self._data.qfrc_applied[dof] = min(max(pull, -limit), limit)

    cdef double _opening(self) noexcept nogil:
        """The opening of the fingers: 0 is closed, 1 is open."""
        cdef double moved = 0.0
        cdef int drive
        for drive in range(self._drives):
            moved += self._data.qpos[self._finger_position[drive]]
        return moved * self._per_travel

    cdef int _step_at(self, double opening) noexcept nogil:
        """Return the last index in the list of widths whose opening is below `opening`."""
        return <int>min(max(opening * self._last_width, 0.0), self._last_width - 1.0)

    cdef double _width(self) noexcept nogil:
        cdef double opening = self._opening()
        cdef int place = self._step_at(opening)
        cdef double share = opening * self._last_width - place
        return self._widths[place] + share * (self._widths[place + 1] - self._widths[place])

    cdef double _opening_at(self, double width) noexcept nogil:
        cdef int place = 0
        while place < self._last_width - 1 and self._widths[place + 1] < width:
            place += 1
        return (
            place + (width - self._widths[place]) / (self._widths[place + 1] - self._widths[place])
        ) / self._last_width

    cdef void _suck(self) noexcept nogil:
        """Update the vacuum, and press the cup and the body under it against each other.

        The air pressure acts on both at the centre of the lip, whose contacts carry the force. So a part
        comes off if the arm pulls with a larger force, and slides if there is too little friction.
        """
        cdef int body = -1, balls = self._covered(&body)
        cdef double share = self._values[VACUUM] / self._full_kpa, aim = 0.0, time_s = OPEN_S
        if self._values[SUCTION] != 0.0:
            aim = 1.0 if balls == LIP_BALLS else OPEN_SHARE
        if aim > share:
            time_s = self._evacuate_s
        share += (aim - share) * min(1.0, self._period_s / time_s)
        self._values[VACUUM] = share * self._full_kpa
        self._press(self._cup, 0.0)
        if self._sucked >= 0:
            self._press(self._sucked, 0.0)
        self._sucked = body
        if body >= 0:
            self._press(self._cup, share * self._holding_n)
            self._press(body, -share * self._holding_n)

    cdef int _covered(self, int* body) noexcept nogil:
        """Return how many balls of the lip touch the body that most of them touch, and that body."""
        cdef const int* body_of = self._model.geom_bodyid
        cdef int touched[LIP_BALLS]
        cdef int index, ball, side, other, count, most = 0
        for ball in range(LIP_BALLS):
            touched[ball] = -1
        for index in range(self._data.ncon):
            for side in range(2):
                ball = self._data.contact[index].geom[side] - self._lip
                if 0 <= ball < LIP_BALLS:
                    touched[ball] = body_of[self._data.contact[index].geom[1 - side]]
        for ball in range(LIP_BALLS):
            count = 0
            for other in range(LIP_BALLS):
                count += touched[other] == touched[ball]
            if touched[ball] >= 0 and count > most:
                most, body[0] = count, touched[ball]
        return most

    cdef void _press(self, int body, double force_n) noexcept nogil:
        """Apply a force to a body along the cup's axis, at the centre of the cup's lip."""
        cdef const double* turn = self._data.xmat + 9 * self._cup
        cdef const double* cup = self._data.xpos + 3 * self._cup
        cdef double* force = self._data.xfrc_applied + 6 * body
        cdef double lever[3]
        cdef int axis
        for axis in range(3):
            force[axis] = force_n * turn[3 * axis + 2]
            lever[axis] = cup[axis] + self._lip_m * turn[3 * axis + 2] - self._data.xipos[3 * body + axis]
        force[3] = lever[1] * force[2] - lever[2] * force[1]
        force[4] = lever[2] * force[0] - lever[0] * force[2]
        force[5] = lever[0] * force[1] - lever[1] * force[0]

    cdef void c_keep_grasp(self) noexcept nogil:
        """Make held parts follow the rotation of the hand. Called between the two halves of a step of the
        plant.

        A contact of MuJoCo controls sliding through the acceleration J dv/dt of one body relative to the
        other. The true acceleration is J dv/dt + dJ/dt v. In a hand on an arm, dJ/dt v is the centripetal
        acceleration, a few m/s². If it is neglected, the part creeps outwards by about 0.1 mm each time it is
        carried.
        """
        cdef const int* body_of = self._model.geom_bodyid
        cdef int index, first, second
        if not (self._has_hand or self._has_cup):
            return
        for index in range(self._data.ncon):
            if self._data.contact[index].efc_address < 0:
                continue
            first = body_of[self._data.contact[index].geom[0]]
            second = body_of[self._data.contact[index].geom[1]]
            if self._gripping[first] or self._gripping[second]:
                self._keep(&self._data.contact[index])

    cdef void _keep(self, const mjContact* contact) noexcept nogil:
        """Subtract a share of dJ/dt v from a contact's reference acceleration, so that the part does not
        slide.

        A contact damps sliding u = J v by the rate b: J v after a step of h is u - h (b u + share dJ/dt v),
        and dJ/dt v adds h dJ/dt v to u before the next one. In the steady state, there is no sliding at the
        middle of a step if the share is 1 - h b / 2.
        """
        cdef double step = self._model.opt.timestep
        # b = 2 / (dmax timeconst) as in MuJoCo, which limits the time constant to at least two steps.
        cdef double share = 1.0 - step / (contact.solimp[1] * max(contact.solref[0], 2.0 * step))
        # dJ/dt v of the second body relative to the first, in the world frame: linear, angular
        cdef double left_out[6]
        cdef double* wanted = self._data.efc_aref + contact.efc_address
        cdef const double* axis
        cdef Py_ssize_t dofs = self._model.nv, row, dof
        cdef int side, part
        for row in range(6):
            left_out[row] = 0.0
        for side in range(2):
            mj_jacDot(
                self._model, self._data, self._turning, self._turning + 3 * dofs, contact.pos,
                self._model.geom_bodyid[contact.geom[side]],
            )
            for row in range(6):
                for dof in range(dofs):
                    left_out[row] += (2 * side - 1) * self._turning[row * dofs + dof] * self._data.qvel[dof]
        for row in range(contact.dim):
            axis = contact.frame + 3 * (row % 3)
            part = 0 if row < 3 else 3
            wanted[row] -= share * (
                axis[0] * left_out[part] + axis[1] * left_out[part + 1] + axis[2] * left_out[part + 2]
            )

    cdef void c_sense(self) noexcept nogil:
        """Read the switches and the hand after a step."""
        cdef Switch* switch
        cdef double seen, before
        cdef int index
        if self._has_hand:
            self._sense_hand()
        for index in range(self._switches):
            switch = &self._switch[index]
            if switch.kind == CONTACT:
                self._values[switch.point] = self._is_pressed(switch)
                continue
            seen = self._look(&switch.ray)
            if switch.kind == DISTANCE:
                self._values[switch.point] = seen
                continue
            before = self._values[switch.point]
            self._values[switch.point] = seen < switch.ray.length_m
            if switch.count >= 0 and self._values[switch.point] > before:
                self._values[switch.count] += 1.0

    cdef void _sense_hand(self) noexcept nogil:
        cdef const mjData* data = self._data
        cdef double width = self._width(), speed = 0.0, force = 0.0
        cdef int place = self._step_at(self._opening()), drive
        cdef double slope = (
            (self._widths[place + 1] - self._widths[place]) * self._last_width * self._per_travel
        )
        for drive in range(self._drives):
            speed += slope * data.qvel[self._finger_dof[drive]]
            force += fabs(data.qfrc_applied[self._finger_dof[drive]])
        self._values[MEASURED_WIDTH] = min(max(width, self._closed_m), self._stroke_m)
        self._values[MEASURED_FORCE] = force / (self._drives * slope)
        if fabs(speed) > STILL_M_S and fabs(width - self._values[WIDTH]) > REACHED_M:
            self._still_cycles = 0
        elif self._still_cycles < self._cycles_to_rest:
            self._still_cycles += 1
        self._values[MOVING] = self._still_cycles < self._cycles_to_rest

    cdef double _look(self, const Ray* ray) noexcept nogil:
        """The distance to the nearest body along the ray, m; the ray's length if there is none."""
        cdef int geom = -1
        cdef double found = mj_ray(
            self._model, self._data, ray.origin, ray.direction, NULL, 1, -1, &geom, NULL
        )
        return found if 0.0 <= found < ray.length_m else ray.length_m

    cdef bint _is_pressed(self, const Switch* switch) noexcept nogil:
        cdef const int* body_of = self._model.geom_bodyid
        cdef double force = 0.0
        cdef int index, address
        for index in range(self._data.ncon):
            address = self._data.contact[index].efc_address
            if address >= 0 and switch.body in (
                body_of[self._data.contact[index].geom[0]], body_of[self._data.contact[index].geom[1]]
            ):
                force += self._data.efc_force[address]
        return force >= switch.force
