"""The kinematics of a serial arm in a few hundred multiplications, for the real-time cycle and the planners.

They are derived from a MuJoCo model once: everything between two joints becomes one fixed part. Each part
ends in a frame whose z axis is that of the next joint. So turning a joint mixes two columns of a matrix, and
the Jacobian needs only these axes and their positions (Siciliano, Sciavicco, Villani, Oriolo, "Robotics",
2009, equation 3.30). Poses are those of the TCP in the base frame.
"""

from libc.math cimport cos, sin
from libc.string cimport memcpy, memset

import mujoco
import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.robot.quaternion cimport cross3, quat_from_matrix

from cobot.errors import InputError
from cobot.robot.rotations import matrix_of, with_z_along


cdef class Chain:
    """Forward kinematics and Jacobian. Joint vectors are shape (dof,), rad (m for a slide).

    The methods for Python share one scratch memory and are not thread safe. Those for compiled code are
    thread safe.

    Attributes:
        dof: the number of joints.
        base_rotation: rotation of the base frame in the world, shape (3, 3).
    """

    def __init__(self, mj, int base, int site):
        """Create the kinematics of a `mujoco.MjModel`.

        Args:
            base: index of the base body.
            site: index of the site at the TCP.

        Raises:
            InputError: there are too many joints, or a joint is neither a hinge nor a slide.
        """
        if mj.nq != mj.njnt or mj.nv != mj.njnt:
            raise InputError("a joint of the model is neither a hinge nor a slide")
        self.dof = checked_dof(mj.njnt)
        self._joints, self._pose = np.zeros(self.dof), np.zeros(7)
        self._rotation, self._jacobian = np.zeros((3, 3)), np.zeros((6, self.dof))
        self._c_joints, self._c_pose = doubles(self._joints, self.dof), doubles(self._pose, 7)
        self._c_rotation = doubles(self._rotation, 9)
        self._c_jacobian = doubles(self._jacobian, 6 * self.dof)
        self._fold(mj, base, site)

    def _fold(self, mj, int base, int site):
        """Walk from the world to the TCP and merge all fixed transforms between two joints into one part."""
        self._count = 0
        self.base_rotation, position = _standing(mj, base)
        turn, offset = self.base_rotation.T, -self.base_rotation.T @ position
        for body in _way_to(mj, mj.site_bodyid[site]):
            turn, offset = turn @ matrix_of(mj.body_quat[body]), offset + turn @ mj.body_pos[body]
            for joint in range(mj.body_jntadr[body], mj.body_jntadr[body] + mj.body_jntnum[body]):
                aligned = with_z_along(mj.jnt_axis[joint])
                self._add_joint(mj, joint, turn @ aligned, offset + turn @ mj.jnt_pos[joint])
                # The following parts are given in the joint's frame, whose origin is the anchor.
                turn, offset = aligned.T, -aligned.T @ mj.jnt_pos[joint]
        self._tail = turn, offset
        self.reach(mj, site)

    def reach(self, mj, int site):
        """Update the TCP after its site has moved. Call it only while no other thread uses this object."""
        turn, offset = self._tail
        offset = offset + turn @ mj.site_pos[site]
        self._set_part(self._count, turn @ matrix_of(mj.site_quat[site]), offset)

    def _add_joint(self, mj, int joint, turn, offset):
        cdef int index = self._count
        self._joint[index] = joint
        self._slides[index] = mj.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        self._rest[index] = mj.qpos0[joint]
        self._set_part(index, turn, offset)
        self._count += 1

    def _set_part(self, int index, turn, offset):
        cdef int i
        for i in range(9):
            self._turn[index][i] = turn[i // 3, i % 3]
        for i in range(3):
            self._offset[index][i] = offset[i]

    cdef void c_forward(self, const double* joints, double* pose7) noexcept nogil:
        """The pose of the TCP: x, y, z (m) and w, x, y, z."""
        cdef double rotation[9]
        self.c_place(joints, pose7, rotation, NULL)
        quat_from_matrix(rotation, &pose7[3])

    cdef void c_forward_jacobian(self, const double* joints, double* pose7, double* jacobian) noexcept nogil:
        """The pose, and the Jacobian, 6 × dof row by row: vx vy vz (m/s) wx wy wz (rad/s) per rad/s."""
        cdef double rotation[9]
        self.c_place(joints, pose7, rotation, jacobian)
        quat_from_matrix(rotation, &pose7[3])

    cdef void c_place(
        self, const double* joints, double* position, double* rotation, double* jacobian
    ) noexcept nogil:
        """Position, rotation matrix (3 × 3, row by row) and, unless it is NULL, the Jacobian."""
        cdef double axes[3 * MAX_DOF]
        cdef double anchors[3 * MAX_DOF]
        cdef double here[3]
        cdef double turn[9]
        cdef double angle
        cdef int index, i
        memcpy(here, self._offset[0], sizeof(here))
        memcpy(turn, self._turn[0], sizeof(turn))
        for index in range(self._count):
            for i in range(3):
                axes[3 * index + i] = turn[3 * i + 2]
            angle = joints[self._joint[index]] - self._rest[index]
            if self._slides[index]:
                for i in range(3):
                    here[i] += angle * axes[3 * index + i]
            else:
                _turn_about_z(turn, cos(angle), sin(angle))
            memcpy(&anchors[3 * index], here, sizeof(here))
            _append(turn, here, self._turn[index + 1], self._offset[index + 1])
        memcpy(position, here, sizeof(here))
        memcpy(rotation, turn, sizeof(turn))
        if jacobian != NULL:
            self._columns(axes, anchors, here, jacobian)

    cdef void c_motion(self, const double* joints, Py_ssize_t apart, double* motion) noexcept nogil:
        """The TCP's twist, 6, and its first two derivatives, one after the other.

        joints: the joints and their first three derivatives, by time or another parameter; `apart` numbers
        lie between the beginnings of two of them.
        """
        # The angular velocity, and its derivatives, of the body behind the last joint.
        cdef double turning[9]
        cdef double moving[9]  # The velocity of the origin of that body.
        cdef double turn[9]
        cdef double arm[3]
        cdef double axis[3]
        cdef double bent[9]
        cdef double q[4]
        cdef int index, i
        memset(turning, 0, sizeof(turning))
        memset(moving, 0, sizeof(moving))
        memcpy(turn, self._turn[0], sizeof(turn))
        for index in range(self._count):
            for i in range(3):
                axis[i] = turn[3 * i + 2]
            for i in range(4):
                q[i] = joints[i * apart + self._joint[index]]
            q[0] -= self._rest[index]
            _differentiate_fixed(turning, axis, bent)
            if self._slides[index]:
                for i in range(3):
                    moving[i] += axis[i] * q[1] + bent[i] * q[0]
                    moving[3 + i] += axis[i] * q[2] + 2.0 * bent[i] * q[1] + bent[3 + i] * q[0]
                    moving[6 + i] += axis[i] * q[3] + bent[6 + i] * q[0]
                    moving[6 + i] += 3.0 * (bent[i] * q[2] + bent[3 + i] * q[1])
            else:
                for i in range(3):
                    turning[i] += axis[i] * q[1]
                    turning[3 + i] += axis[i] * q[2] + bent[i] * q[1]
                    turning[6 + i] += axis[i] * q[3] + 2.0 * bent[i] * q[2] + bent[3 + i] * q[1]
                _turn_about_z(turn, cos(q[0]), sin(q[0]))
            memset(arm, 0, sizeof(arm))
            _append(turn, arm, self._turn[index + 1], self._offset[index + 1])
            _differentiate_fixed(turning, arm, bent)
            for i in range(9):
                moving[i] += bent[i]
        for i in range(9):
            motion[i + 3 * (i // 3)] = moving[i]
            motion[i + 3 * (i // 3) + 3] = turning[i]

    cdef void _columns(
        self, const double* axes, const double* anchors, const double* tcp, double* jacobian
    ) noexcept nogil:
        """A hinge moves the TCP around its axis, a slide along it."""
        cdef const double* axis
        cdef double arm[3]
        cdef double linear[3]
        cdef bint slides
        cdef int index, i, column
        if self._count < self.dof:
            memset(jacobian, 0, 6 * self.dof * sizeof(double))
        for index in range(self._count):
            axis, slides, column = &axes[3 * index], self._slides[index], self._joint[index]
            for i in range(3):
                arm[i] = tcp[i] - anchors[3 * index + i]
            cross3(axis, arm, linear)
            for i in range(3):
                jacobian[i * self.dof + column] = axis[i] if slides else linear[i]
                jacobian[(3 + i) * self.dof + column] = 0.0 if slides else axis[i]

    def forward_into(self, joints, out):
        """The TCP's pose, x, y, z (m) and w, x, y, z, into `out`, shape (7,)."""
        self._joints[...] = joints
        self.c_forward(self._c_joints, self._c_pose)
        np.copyto(out, self._pose)

    def solve(self, joints):
        """Position (3,), rotation matrix (3, 3) and Jacobian (6, dof). The next call overwrites all three."""
        self._joints[...] = joints
        self.c_place(self._c_joints, self._c_pose, self._c_rotation, self._c_jacobian)
        return self._pose[:3], self._rotation, self._jacobian

    def poses(self, rows):
        """The TCP's poses, shape (n, 7), at joints of shape (n, dof)."""
        given = np.array(rows, dtype=np.float64).reshape(-1, self.dof)  # a copy, so contiguous and writable
        out = np.empty((len(given), 7))
        if len(given) == 0:
            return out
        cdef Py_ssize_t count = len(given), row
        cdef const double* joints = doubles(given, count * self.dof)
        cdef double* poses = doubles(out, count * 7)
        with nogil:
            for row in range(count):
                self.c_forward(&joints[row * self.dof], &poses[7 * row])
        return out

    def twists(self, rows, rates):
        """The TCP's velocities, shape (n, 6), m/s and rad/s in the base frame, at joints and joint velocities
        of shape (n, dof)."""
        given = np.array(rows, dtype=np.float64).reshape(-1, self.dof)
        moved = np.array(rates, dtype=np.float64).reshape(-1, self.dof)
        out = np.zeros((len(given), 6))
        if len(given) == 0 or moved.shape != given.shape:
            return out
        cdef Py_ssize_t count = len(given), row
        cdef const double* joints = doubles(given, count * self.dof)
        cdef const double* velocity = doubles(moved, count * self.dof)
        cdef double* twist = doubles(out, count * 6)
        cdef double jacobian[6 * MAX_DOF]
        cdef double pose[7]
        cdef int i, j
        with nogil:
            for row in range(count):
                self.c_forward_jacobian(&joints[row * self.dof], pose, jacobian)
                for i in range(6):
                    for j in range(self.dof):
                        twist[6 * row + i] += jacobian[i * self.dof + j] * velocity[row * self.dof + j]
        return out

    def motions(self, derivatives):
        """The TCP's twist and its first two derivatives in the base frame, shape (3, n, 6), for joints and
        their first three derivatives, shape (4, n, dof)."""
        given = np.array(derivatives, dtype=np.float64, order="C")
        if given.ndim != 3 or len(given) != 4 or given.shape[2] != self.dof:
            raise ValueError(f"joints and derivatives of shape {given.shape}, not (4, n, {self.dof})")
        cdef Py_ssize_t count = given.shape[1], row
        out = np.empty((count, 3, 6))
        if count == 0:
            return out.swapaxes(0, 1)
        cdef const double* joints = doubles(given, 4 * count * self.dof)
        cdef double* motion = doubles(out, 18 * count)
        with nogil:
            for row in range(count):
                self.c_motion(&joints[row * self.dof], count * self.dof, &motion[18 * row])
        return out.swapaxes(0, 1)


cdef inline void _differentiate_fixed(const double* turning, const double* arm, double* out) noexcept nogil:
    """The first three derivatives of a vector that is fixed in a turning body."""
    cdef double first[3]
    cdef double second[3]
    cdef double third[3]
    cdef int i
    cross3(turning, arm, out)
    cross3(&turning[3], arm, first)
    cross3(turning, out, &out[3])
    for i in range(3):
        out[3 + i] += first[i]
    cross3(&turning[6], arm, first)
    cross3(&turning[3], out, second)
    cross3(turning, &out[3], third)
    for i in range(3):
        out[6 + i] = first[i] + 2.0 * second[i] + third[i]


cdef inline void _turn_about_z(double* turn, double c, double s) noexcept nogil:
    """turn = turn Rz, which mixes the columns x and y."""
    cdef double x, y
    cdef int i
    for i in range(0, 9, 3):
        x, y = turn[i], turn[i + 1]
        turn[i] = c * x + s * y
        turn[i + 1] = c * y - s * x


cdef inline void _append(double* turn, double* here, const double* part, const double* offset) noexcept nogil:
    """Append a fixed part: here += turn offset, turn = turn part."""
    cdef double x, y, z
    cdef int i, j
    for i in range(3):
        x, y, z = turn[3 * i], turn[3 * i + 1], turn[3 * i + 2]
        here[i] += x * offset[0] + y * offset[1] + z * offset[2]
        for j in range(3):
            turn[3 * i + j] = x * part[j] + y * part[3 + j] + z * part[6 + j]


def _way_to(mj, body):
    """The bodies from the first one below the world to `body`."""
    bodies = []
    while body > 0:
        bodies.insert(0, int(body))
        body = mj.body_parentid[body]
    return bodies


def _standing(mj, body):
    """Rotation and position in the world of a body that no joint moves."""
    turn, offset = np.eye(3), np.zeros(3)
    for each in _way_to(mj, body):
        turn, offset = turn @ matrix_of(mj.body_quat[each]), offset + turn @ mj.body_pos[each]
    return turn, offset
