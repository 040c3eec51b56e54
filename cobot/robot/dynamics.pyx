"""Inertia and bias forces of the arm, computed by MuJoCo in separate memory, and efforts along a motion.

The efforts of many rows are computed here, for eight rows at once, with the recursive Newton-Euler algorithm
in the frames of the joints (R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 5.3). MuJoCo
takes nine times as long. All processors compute the same figures, see `interior_point.pyx`.

Joint vectors are shape (dof,): rad, rad/s, N·m. Not thread safe. Values that are not finite give results that
are not finite, and have no other effect.
"""

from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.robot.mujoco cimport (
    kinematic_data_of,
    mj_comPos,
    mj_comVel,
    mj_crb,
    mj_deleteData,
    mj_fullM,
    mj_kinematics,
    mj_rne,
    mj_setConst,
    mjDSBL_GRAVITY,
    mjJNT_SLIDE,
    mjModel,
    mju_quat2Mat,
    model_of,
)

cdef extern from *:
    """
    #include <math.h>

    #if defined(__GNUC__) && !defined(__clang__) && defined(__OPTIMIZE__)
    #pragma GCC optimize ("O3")
    #if defined(__x86_64__) && defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
    #define FOR_EACH_PROCESSOR __attribute__((target_clones("avx512f", "avx2", "default")))
    #endif
    #endif
    #ifndef FOR_EACH_PROCESSOR
    #define FOR_EACH_PROCESSOR
    #endif

    #define LANES 8
    #define JOINTS 16
    typedef double Lanes __attribute__((vector_size(8 * LANES)));

    /* A joint, and the bodies that it moves and no later joint. Its frame is that of the body at rest, with
       the origin on the axis; `turn` and `offset` place it in the frame of the joint before. `first` and
       `second` are the moments of the mass about the origin; `second` is the inertia. */
    typedef struct {
        int before, slides;
        double rest, axis[3], turn[9], offset[3], mass, first[3], second[9], armature;
    } Moved;

    static inline void add_cross(const Lanes *a, const Lanes *b, Lanes *out) {
        out[0] += a[1] * b[2] - a[2] * b[1];
        out[1] += a[2] * b[0] - a[0] * b[2];
        out[2] += a[0] * b[1] - a[1] * b[0];
    }

    static inline void turn_by(const Lanes *turn, const Lanes *given, Lanes *out) {
        for (int i = 0; i < 3; i++)
            out[i] = turn[3 * i] * given[0] + turn[3 * i + 1] * given[1] + turn[3 * i + 2] * given[2];
    }

    static inline void turn_back(const Lanes *turn, const Lanes *given, Lanes *out) {
        for (int i = 0; i < 3; i++)
            out[i] = turn[i] * given[0] + turn[3 + i] * given[1] + turn[6 + i] * given[2];
    }

    /* The rotation about a joint's axis, before the joint's own `turn`. */
    static inline void rotation(const Moved *joint, const Lanes *sine, const Lanes *cosine, Lanes *out) {
        const double *axis = joint->axis, *turn = joint->turn;
        Lanes own[9], rest = 1.0 - *cosine;
        for (int i = 0; i < 3; i++) {
            int k = (i + 1) % 3, n = (i + 2) % 3;
            own[3 * i + i] = *cosine + axis[i] * axis[i] * rest;
            own[3 * i + k] = axis[i] * axis[k] * rest - axis[n] * *sine;
            own[3 * i + n] = axis[i] * axis[n] * rest + axis[k] * *sine;
        }
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                out[3 * i + k] = turn[3 * i] * own[k] + turn[3 * i + 1] * own[3 + k]
                    + turn[3 * i + 2] * own[6 + k];
    }

    /* The efforts of up to LANES rows of joints, each of shape (count, dof). Unused lanes repeat the last
       row. */
    FOR_EACH_PROCESSOR
    static void compute_efforts(const Moved *joints, int dof, const double *gravity, const double *q,
                                const double *v, const double *a, int count, double *out) {
        const Lanes none = {0.0};
        Lanes turn[JOINTS][9], offset[JOINTS][3], spin[JOINTS][3], spin_up[JOINTS][3], speed_up[JOINTS][3];
        Lanes force[JOINTS][3], moment[JOINTS][3], acceleration[JOINTS];
        for (int joint = 0; joint < dof; joint++) {
            const Moved *moved = &joints[joint];
            Lanes sine, cosine, place, rate, still[3] = {none, none, none};
            Lanes lift[3] = {none - gravity[0], none - gravity[1], none - gravity[2]};
            const Lanes *spin_in = still, *spin_up_in = still, *speed_up_in = lift;
            for (int lane = 0; lane < LANES; lane++) {
                int at = (lane < count ? lane : count - 1) * dof + joint;
                place[lane] = q[at] - moved->rest, rate[lane] = v[at], acceleration[joint][lane] = a[at];
                sine[lane] = moved->slides ? 0.0 : sin(place[lane]);
                cosine[lane] = moved->slides ? 1.0 : cos(place[lane]);
            }
            rotation(moved, &sine, &cosine, turn[joint]);
            if (moved->before >= 0) {
                spin_in = spin[moved->before], spin_up_in = spin_up[moved->before];
                speed_up_in = speed_up[moved->before];
            }
            Lanes axis[3], carried[3], swung[3] = {none, none, none};
            for (int i = 0; i < 3; i++) {
                axis[i] = none + moved->axis[i];
                offset[joint][i] = none + moved->offset[i];
            }
            if (moved->slides) {
                turn_by(turn[joint], axis, carried);
                for (int i = 0; i < 3; i++) offset[joint][i] += place * carried[i];
            }
            add_cross(spin_in, offset[joint], swung);
            for (int i = 0; i < 3; i++) carried[i] = speed_up_in[i];
            add_cross(spin_up_in, offset[joint], carried);
            add_cross(spin_in, swung, carried);
            turn_back(turn[joint], carried, speed_up[joint]);
            turn_back(turn[joint], spin_in, spin[joint]);
            turn_back(turn[joint], spin_up_in, spin_up[joint]);
            Lanes by_rate[3];
            for (int i = 0; i < 3; i++) by_rate[i] = axis[i] * rate;
            if (moved->slides) {
                for (int i = 0; i < 3; i++) {
                    speed_up[joint][i] += axis[i] * acceleration[joint];
                    by_rate[i] *= 2.0;
                }
                add_cross(spin[joint], by_rate, speed_up[joint]);
            } else {
                add_cross(spin[joint], by_rate, spin_up[joint]);
                for (int i = 0; i < 3; i++) {
                    spin_up[joint][i] += axis[i] * acceleration[joint];
                    spin[joint][i] += by_rate[i];
                }
            }
            Lanes first[3], turning[3];
            const double *second = moved->second;
            for (int i = 0; i < 3; i++) first[i] = none + moved->first[i], swung[i] = none;
            add_cross(spin[joint], first, swung);
            for (int i = 0; i < 3; i++) {
                force[joint][i] = moved->mass * speed_up[joint][i];
                moment[joint][i] = none;
                turning[i] = none;
                for (int k = 0; k < 3; k++) {
                    moment[joint][i] += second[3 * i + k] * spin_up[joint][k];
                    turning[i] += second[3 * i + k] * spin[joint][k];
                }
            }
            add_cross(spin_up[joint], first, force[joint]);
            add_cross(spin[joint], swung, force[joint]);
            add_cross(spin[joint], turning, moment[joint]);
            add_cross(first, speed_up[joint], moment[joint]);
        }
        for (int joint = dof - 1; joint >= 0; joint--) {
            const Moved *moved = &joints[joint];
            const Lanes *load = moved->slides ? force[joint] : moment[joint];
            Lanes effort = moved->armature * acceleration[joint], passed[3], lever[3];
            for (int i = 0; i < 3; i++) effort += moved->axis[i] * load[i];
            for (int lane = 0; lane < count; lane++) out[lane * dof + joint] = effort[lane];
            if (moved->before < 0) continue;
            turn_by(turn[joint], force[joint], passed);
            turn_by(turn[joint], moment[joint], lever);
            add_cross(offset[joint], passed, lever);
            for (int i = 0; i < 3; i++) {
                force[moved->before][i] += passed[i];
                moment[moved->before][i] += lever[i];
            }
        }
    }
    """
    enum:
        LANES
    ctypedef struct Moved:
        int before
        bint slides
        double rest
        double axis[3]
        double turn[9]
        double offset[3]
        double mass
        double first[3]
        double second[9]
        double armature
    void compute_efforts(const Moved*, int, const double*, const double*, const double*, const double*, int,
                         double*) noexcept nogil


cdef class Dynamics:
    """The dynamics of a `mujoco.MjModel` with one coordinate per joint."""

    def __cinit__(self, mj):
        self._mj = mj
        self._dof = checked_dof(mj.nv)
        self._joints, self._velocity = np.zeros(self._dof), np.zeros(self._dof)
        self._c_joints = doubles(self._joints, self._dof)
        self._c_velocity = doubles(self._velocity, self._dof)
        self._model = model_of(mj)
        self._frames = <Frame*>calloc(self._model.nbody, sizeof(Frame))
        if self._frames == NULL:
            raise MemoryError("no memory for the bodies")
        self._data = kinematic_data_of(self._model)

    def __dealloc__(self):
        free(self._frames)
        if self._data != NULL:
            mj_deleteData(self._data)

    def settle(self):
        """Recompute the model's constants after its masses have changed. Takes about 10 µs."""
        mj_setConst(<mjModel*>self._model, self._data)

    cdef void c_mass_matrix(self, const double* joints, double* full) noexcept nogil:
        """Joint-space inertia, dof × dof, kg·m², including the drives' inertia (armature)."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_crb(self._model, self._data)
        mj_fullM(self._model, self._data, full)

    cdef void c_bias_torques(
        self, const double* joints, const double* velocity, double* torques
    ) noexcept nogil:
        """The torques for a motion without acceleration: gravity, Coriolis and centrifugal forces."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        memcpy(self._data.qvel, velocity, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_comVel(self._model, self._data)
        mj_rne(self._model, self._data, 0, torques)

    def inverse(self, joints, velocity, acceleration):
        """The torques for rows of joint states, shape (..., dof), N·m, without friction."""
        shape = np.shape(joints)
        states = (joints, velocity, acceleration)
        given = [
            np.array(each if np.shape(each) == shape else np.broadcast_to(each, shape), np.float64, order="C")
            for each in states
        ]
        torques = np.zeros(shape)
        if torques.size == 0:
            return torques
        if shape[len(shape) - 1] != self._dof:
            raise ValueError(f"rows of {self._dof} joints are needed, not {shape}")
        cdef Py_ssize_t rows = torques.size // self._dof, row, begin
        cdef const double* q = doubles(given[0], torques.size)
        cdef const double* v = doubles(given[1], torques.size)
        cdef const double* a = doubles(given[2], torques.size)
        cdef double* out = doubles(torques, torques.size)
        cdef double gravity[3]
        cdef Moved[MAX_DOF] joints_moved
        cdef int i
        for i in range(3):
            gravity[i] = 0.0 if self._model.opt.disableflags & mjDSBL_GRAVITY else self._model.opt.gravity[i]
        _fold(self._model, self._frames, joints_moved)
        for row in range(0, rows, <Py_ssize_t>LANES):
            begin = row * self._dof
            compute_efforts(
                joints_moved, self._dof, gravity, &q[begin], &v[begin], &a[begin],
                min(rows - row, <Py_ssize_t>LANES), &out[begin],
            )
        return torques

    def mass_matrix(self, joints):
        """Joint-space inertia, shape (dof, dof), kg·m²."""
        self._joints[...] = joints
        full = np.zeros((self._dof, self._dof))
        self.c_mass_matrix(self._c_joints, doubles(full, self._dof * self._dof))
        return full

    def bias_torques(self, joints, velocity):
        """The torques for a motion without acceleration, shape (dof,), N·m, without friction."""
        self._joints[...] = joints
        self._velocity[...] = velocity
        torques = np.zeros(self._dof)
        self.c_bias_torques(self._c_joints, self._c_velocity, doubles(torques, self._dof))
        return torques


cdef void _fold(const mjModel* model, Frame* frames, Moved* joints) noexcept nogil:
    """Fill in the joints. The model's masses may have changed since the last call."""
    cdef Frame* frame
    cdef Moved* moved
    cdef double own[9]
    cdef int body, each, i
    frames[0].joint = -1
    for i in range(9):
        frames[0].turn[i] = 1.0 if i % 4 == 0 else 0.0
    memset(frames[0].offset, 0, sizeof(frames[0].offset))
    for body in range(1, model.nbody):
        frame = &frames[body]
        frame[0] = frames[model.body_parentid[body]]
        _shift(frame.turn, &model.body_pos[3 * body], frame.offset)
        mju_quat2Mat(own, &model.body_quat[4 * body])
        _turn(frame.turn, own)
        for each in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            moved = &joints[each]
            memset(moved, 0, sizeof(Moved))
            moved.before, moved.rest = frame.joint, model.qpos0[each]
            moved.slides = model.jnt_type[each] == mjJNT_SLIDE
            moved.armature = model.dof_armature[each]
            _shift(frame.turn, &model.jnt_pos[3 * each], frame.offset)
            memcpy(moved.turn, frame.turn, sizeof(moved.turn))
            memcpy(moved.offset, frame.offset, sizeof(moved.offset))
            frame.joint = each
            for i in range(9):
                frame.turn[i] = 1.0 if i % 4 == 0 else 0.0
            for i in range(3):
                moved.axis[i] = model.jnt_axis[3 * each + i]
                frame.offset[i] = -model.jnt_pos[3 * each + i]
        if frame.joint >= 0:
            _add_mass(model, frame, body, &joints[frame.joint])


cdef void _add_mass(const mjModel* model, const Frame* frame, int body, Moved* moved) noexcept nogil:
    """Add the moments of a body's mass to those of the joint that moves it."""
    cdef double turn[9]
    cdef double own[9]
    cdef double centre[3]
    cdef double mass = model.body_mass[body]
    cdef const double* principal = &model.body_inertia[3 * body]
    cdef double square = 0.0
    cdef int i, k, n
    memcpy(centre, frame.offset, sizeof(centre))
    _shift(frame.turn, &model.body_ipos[3 * body], centre)
    memcpy(turn, frame.turn, sizeof(turn))
    mju_quat2Mat(own, &model.body_iquat[4 * body])
    _turn(turn, own)
    moved.mass += mass
    for i in range(3):
        moved.first[i] += mass * centre[i]
        square += centre[i] * centre[i]
    for i in range(3):
        moved.second[4 * i] += mass * square
        for k in range(3):
            moved.second[3 * i + k] -= mass * centre[i] * centre[k]
            for n in range(3):
                moved.second[3 * i + k] += turn[3 * i + n] * principal[n] * turn[3 * k + n]


cdef void _turn(double* turn, const double* by) noexcept nogil:
    """Multiply a matrix by another one from the right."""
    cdef double before[9]
    cdef int i, k
    memcpy(before, turn, sizeof(before))
    for i in range(0, 9, 3):
        for k in range(3):
            turn[i + k] = before[i] * by[k] + before[i + 1] * by[3 + k] + before[i + 2] * by[6 + k]


cdef void _shift(const double* turn, const double* given, double* out) noexcept nogil:
    """Move a point by an offset that a matrix turns."""
    cdef int i
    for i in range(3):
        out[i] += turn[3 * i] * given[0] + turn[3 * i + 1] * given[1] + turn[3 * i + 2] * given[2]
