"""The simulated arm in a cell: with a hand, parts, fixtures, belts, switches, inputs and outputs.

The drives compute with the arm's own model, as they do without a cell. The simulation steps another model,
the plant. The drives send torques to the plant, which returns positions and velocities. So to the drives, the
hand, its load and contacts are external effects that their model does not include, as on a real arm.
"""

from libc.string cimport memcpy

import mujoco

from cobot.arrays cimport doubles
from cobot.robot.mujoco cimport (
    data_of,
    mj_step1,
    mj_step2,
    mju_mulQuat,
    mju_rotVecQuat,
    model_of,
)

from dataclasses import replace

from cobot.cell.plant import plant_of
from cobot.robot.load import beyond
from cobot.robot.payload import Carrier
from rtloop.backends.cell_devices import CellDevices
from rtloop.backends.mujoco import MujocoBackend

cdef class CellBackend(MujocoBackend):
    capabilities = replace(MujocoBackend.capabilities, io=True)
    report_period_s = 0.01

    def __init__(self, settings: object, limits: object) -> None:
        super().__init__(settings, limits)
        cdef int dof = self._dof
        names = settings.robot
        plant = self.plant = plant_of(self._robot, settings)
        model = plant.mj
        model.opt.timestep = settings.rt.period_s
        model.actuator_ctrlrange[:dof] = self._model.actuator_ctrlrange
        self._plant_data = mujoco.MjData(model)
        self._c_plant_model, self._c_plant = model_of(model), data_of(self._plant_data)
        self._plant_tcp_body = plant.tcp_body
        self._devices = CellDevices(plant, self._plant_data, settings.rt.period_s)
        self._sensed = self._c_plant
        self._observer.solve_by(self._plant_data)
        # Contacts, limits and dry friction act in the plant.
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        base = model.body(names.base_frame).id
        self._carrier = Carrier(model, base, plant.flange)
        self.part_names = tuple(plant.cell.parts)
        self._part_places = [model.jnt_qposadr[model.body_jntadr[body]] for body in plant.parts]
        inverse = plant.base.inverse().quaternion
        for axis in range(3):
            self._base_position[axis] = plant.base.position[axis]
        for axis in range(4):
            self._base_inverse[axis] = inverse[axis]
        self._make_up_for_losses()

    def open(self, initial_position: object) -> None:
        super().open(initial_position)
        mujoco.mj_resetData(self.plant.mj, self._plant_data)
        self._plant_data.qpos[:] = self.plant.start
        self._plant_data.qpos[:self._dof] = initial_position
        self._devices.reset()
        self._plant_data.ctrl[:] = self._data.qfrc_bias
        mujoco.mj_forward(self.plant.mj, self._plant_data)
        self._take_over()
        self._devices.c_sense()
        self._report()

    def set_tool(self, tool: object) -> None:
        super().set_tool(tool)
        self.plant.mj.opt.gravity[:] = self._model.opt.gravity

    def mount(self, tool: object) -> None:
        self._carrier.load(beyond(tool, self.plant.tool), self._model.opt.gravity)

    def io(self) -> object:
        return self._devices.io()

    def set_output(self, name: str, value: float) -> None:
        self._devices.set_output(name, value)

    def read_input(self, name: str) -> float:
        return self._devices.read_input(name)

    @property
    def _stepped(self):
        return self.plant.mj

    def reset_cell(self) -> None:
        data, dof = self._plant_data, self._dof
        data.qpos[dof:] = self.plant.start[dof:]
        data.qvel[dof:] = 0.0
        data.qacc_warmstart[:] = 0.0
        data.qfrc_applied[dof:] = 0.0
        self._devices.reset()

    def part_poses(self, poses: object) -> None:
        cdef double* out = doubles(poses, 7 * len(self._part_places))
        cdef double offset[3]
        cdef int place, axis
        for place in self._part_places:
            for axis in range(3):
                offset[axis] = self._c_plant.qpos[place + axis] - self._base_position[axis]
            mju_rotVecQuat(out, offset, self._base_inverse)
            mju_mulQuat(out + 3, self._base_inverse, self._c_plant.qpos + place + 3)
            out += 7

    cdef void _step(self, const double* command) noexcept nogil:
        mj_step1(self._c_model, self._c_data)
        self._find_torques(command)
        mj_step1(self._c_plant_model, self._c_plant)
        memcpy(self._c_plant.ctrl, self._c_data.ctrl, self._dof * sizeof(double))
        self._devices.c_drive()
        self._devices.c_keep_grasp()
        self._push_on(self._c_plant, self._plant_tcp_body)
        self._pull_on(self._c_plant_model, self._c_plant)
        mj_step2(self._c_plant_model, self._c_plant)
        self._take_over()
        self._observer.c_update()
        self._devices.c_sense()

    cdef void _take_over(self) noexcept nogil:
        """Set the arm's model to the positions and velocities of the plant."""
        cdef size_t size = self._dof * sizeof(double)
        memcpy(self._c_data.qpos, self._c_plant.qpos, size)
        memcpy(self._c_data.qvel, self._c_plant.qvel, size)
        memcpy(self._c_data.actuator_force, self._c_plant.actuator_force, size)
        memcpy(self._c_data.qfrc_actuator, self._c_plant.qfrc_actuator, size)

    cdef _make_up_for_losses(self):
        MujocoBackend._make_up_for_losses(self)
        if self.plant is None:
            return
        self.plant.mj.dof_damping[:self._dof] = self._model.dof_damping
        self.plant.mj.dof_frictionloss[:self._dof] = self._model.dof_frictionloss
