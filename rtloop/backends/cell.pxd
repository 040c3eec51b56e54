from cobot.robot.mujoco cimport mjData, mjModel
from rtloop.backends.cell_devices cimport CellDevices
from rtloop.backends.mujoco cimport MujocoBackend


cdef class CellBackend(MujocoBackend):
    cdef const mjModel* _c_plant_model
    cdef mjData* _c_plant
    cdef readonly object plant, _plant_data, part_names
    cdef object _carrier, _part_places
    cdef CellDevices _devices
    cdef int _plant_tcp_body
    cdef double _base_position[3]
    cdef double _base_inverse[4]
    cdef void _take_over(self) noexcept nogil
