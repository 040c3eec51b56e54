"""The part of MuJoCo's C interface that compiled modules use.

Cython knows only the names declared here; sizes and offsets come from MuJoCo's headers. The model and the
data belong to Python objects. Code that takes their address must keep these objects as attributes.

An invalid argument makes MuJoCo end the process, so callers must pass valid and finite numbers.
"""

from libc.stdint cimport int64_t, uint8_t, uintptr_t


cdef extern from "mujoco/mujoco.h" nogil:
    enum:
        mjJNT_FREE
        mjJNT_BALL
        mjJNT_SLIDE
        mjJNT_HINGE

    enum:
        mjGEOM_PLANE
        mjGEOM_SPHERE
        mjGEOM_CAPSULE
        mjGEOM_ELLIPSOID
        mjGEOM_CYLINDER
        mjGEOM_BOX
        mjGEOM_MESH

    enum:
        mjDSBL_GRAVITY

    enum:
        mjSENS_FORCE
        mjSENS_TORQUE

    enum:
        mjCNSTR_EQUALITY
        mjCNSTR_FRICTION_DOF
        mjCNSTR_LIMIT_JOINT

    enum:
        mjWARN_BADQPOS
        mjWARN_BADQVEL
        mjWARN_BADQACC
        mjWARN_BADCTRL

    ctypedef struct mjOption:
        double timestep
        double gravity[3]
        int integrator
        int disableflags
        int enableflags

    ctypedef struct mjModel:
        int64_t nq
        int64_t nv
        int64_t nu
        int64_t na
        int64_t nbody
        int64_t njnt
        int64_t ngeom
        int64_t nsite
        int64_t neq
        int64_t nsensor
        int64_t nsensordata
        int64_t narena
        mjOption opt
        double* qpos0
        int* body_parentid
        int* body_rootid
        int* body_weldid
        int* body_jntnum
        int* body_jntadr
        double* body_pos
        double* body_quat
        double* body_ipos
        double* body_iquat
        double* body_mass
        double* body_inertia
        int* jnt_type
        int* jnt_qposadr
        int* jnt_dofadr
        int* jnt_bodyid
        double* jnt_pos
        double* jnt_axis
        double* jnt_range
        double* dof_armature
        double* dof_damping
        double* dof_frictionloss
        int* geom_type
        int* geom_bodyid
        double* geom_size
        double* geom_rbound
        double* geom_aabb
        double* geom_surfacevel
        int* site_bodyid
        double* site_pos
        double* site_quat
        uint8_t* eq_active0
        double* eq_data
        double* actuator_gainprm
        double* actuator_biasprm
        double* actuator_ctrlrange
        double* actuator_forcerange
        int* sensor_adr
        int* sensor_dim
        int* M_rownnz
        int* M_rowadr
        int* M_colind

    ctypedef struct mjWarningStat:
        int lastinfo
        int number

    ctypedef struct mjContact:
        double dist
        double pos[3]
        double frame[9]
        double solref[2]
        double solimp[5]
        int dim
        int geom[2]
        int exclude
        int efc_address

    ctypedef struct mjData:
        mjWarningStat* warning
        int ncon
        int ne
        int nf
        int nl
        int nefc
        double time
        double* qpos
        double* qvel
        double* act
        double* qacc_warmstart
        double* ctrl
        double* qfrc_applied
        double* xfrc_applied
        uint8_t* eq_active
        double* mocap_pos
        double* mocap_quat
        double* qacc
        double* sensordata
        double* xpos
        double* xquat
        double* xmat
        double* xipos
        double* xanchor
        double* xaxis
        double* geom_xpos
        double* geom_xmat
        double* site_xpos
        double* site_xmat
        double* subtree_com
        double* cdof
        double* M
        double* qfrc_bias
        double* qfrc_passive
        double* qfrc_damper
        double* actuator_length
        double* actuator_velocity
        double* actuator_force
        double* qfrc_actuator
        double* qfrc_constraint
        double* qfrc_smooth
        double* cfrc_ext
        mjContact* contact
        int* efc_type
        int* efc_id
        double* efc_pos
        double* efc_vel
        double* efc_aref
        double* efc_force

    mjModel* mj_copyModel(mjModel* dest, const mjModel* src)
    void mj_deleteModel(mjModel* m)
    mjData* mj_makeData(const mjModel* m)
    mjData* mj_copyData(mjData* dest, const mjModel* m, const mjData* src)
    void mj_setConst(mjModel* m, mjData* d)
    void mj_resetData(const mjModel* m, mjData* d)
    void mj_deleteData(mjData* d)

    void mj_step(const mjModel* m, mjData* d)
    void mj_step1(const mjModel* m, mjData* d)
    void mj_step2(const mjModel* m, mjData* d)
    void mj_forward(const mjModel* m, mjData* d)
    void mj_fwdPosition(const mjModel* m, mjData* d)
    void mj_fwdVelocity(const mjModel* m, mjData* d)
    void mj_kinematics(const mjModel* m, mjData* d)
    void mj_comPos(const mjModel* m, mjData* d)
    void mj_comVel(const mjModel* m, mjData* d)
    void mj_collision(const mjModel* m, mjData* d)
    void mj_crb(const mjModel* m, mjData* d)
    void mj_makeM(const mjModel* m, mjData* d)
    void mj_factorM(const mjModel* m, mjData* d)
    void mj_passive(const mjModel* m, mjData* d)
    void mj_rne(const mjModel* m, mjData* d, int flg_acc, double* result)
    void mj_rnePostConstraint(const mjModel* m, mjData* d)

    void mj_fullM(const mjModel* m, const mjData* d, double* dst)
    void mj_mulM(const mjModel* m, const mjData* d, double* res, const double* vec)
    void mj_solveM(const mjModel* m, mjData* d, double* x, const double* y, int n)
    void mj_jac(const mjModel* m, const mjData* d, double* jacp, double* jacr, const double* point, int body)
    void mj_jacDot(const mjModel* m, const mjData* d, double* jacp, double* jacr, const double* point,
                   int body)
    void mj_jacSite(const mjModel* m, const mjData* d, double* jacp, double* jacr, int site)
    void mj_applyFT(const mjModel* m, mjData* d, const double* force, const double* torque,
                    const double* point, int body, double* qfrc_target)
    double mj_ray(const mjModel* m, const mjData* d, const double* pnt, const double* vec,
                  const uint8_t* geomgroup, int flg_static, int bodyexclude, int* geomid, double* normal)
    double mj_geomDistance(const mjModel* m, mjData* d, int geom1, int geom2, double distmax, double* fromto)

    int mju_cholFactor(double* mat, int n, double mindiag)
    void mju_cholSolve(double* res, const double* mat, const double* vec, int n)
    void mju_mat2Quat(double* quat, const double* mat)
    void mju_mulQuat(double* res, const double* quat1, const double* quat2)
    void mju_negQuat(double* res, const double* quat)
    void mju_quat2Mat(double* res, const double* quat)
    void mju_rotVecQuat(double* res, const double* vec, const double* quat)
    void mju_subQuat(double* res, const double* qa, const double* qb)


cdef inline const mjModel* model_of(object model) except NULL:
    """The C model of a `mujoco.MjModel`, which the caller must keep alive."""
    return <const mjModel*><uintptr_t>model._address


cdef inline mjData* data_of(object data) except NULL:
    """The C data of a `mujoco.MjData`, which the caller must keep alive."""
    return <mjData*><uintptr_t>data._address


cdef inline mjData* kinematic_data_of(const mjModel* model) except NULL:
    """New data for kinematics, inertia and distances. `mj_deleteData` frees it.

    A model reserves an arena for the contacts and constraints of a simulation, 13 MB for the shipped arm, and
    a real-time process keeps all of it resident. These computations need only some kB.
    """
    cdef mjModel* small = mj_copyModel(NULL, model)
    if small == NULL:
        raise MemoryError("no memory for a copy of the model")
    small.narena = min(small.narena, <int64_t>1 << 20)
    cdef mjData* data = mj_makeData(small)
    mj_deleteModel(small)
    if data == NULL:
        raise MemoryError("no memory for the model's data")
    return data
