from cobot.arrays cimport MAX_DOF
from cobot.robot.dynamics cimport Dynamics
from rtloop.generators.rates cimport Rates
from rtloop.sources.source cimport Source


cdef class TorqueSource(Source):
    cdef Dynamics dynamics
    cdef Rates rates
    cdef double period_s
    cdef double torque[MAX_DOF]
    cdef double damping[MAX_DOF]
    cdef double max_effort[MAX_DOF]
