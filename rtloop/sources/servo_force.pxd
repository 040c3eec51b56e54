from cobot.arrays cimport MAX_DOF
from rtloop.sources.cartesian cimport CartesianSource
from rtloop.sources.servo_base cimport ServoSource


cdef class ForceServo(CartesianSource):
    cdef ServoSource points
    cdef double before_points[MAX_DOF]
    cdef double pose[7]
