from rtloop.streaming.session cimport Session


cdef enum Known:
    # What streams know of what stands around the arm.
    ALL = 0  # Or why not: then they are refused.
    CHANGED = 1  # It is read as soon as the arm rests; whatever moves it may go on.
    BEING_READ = 2  # By a thread: whatever would move the arm waits.


cdef class ToolAndScene:
    cdef readonly object surroundings
    cdef readonly object scene_known
    cdef Known known
    cdef object _model, _info, _tool, _backend, _max_payload_kg
    cdef Session _streaming

    cdef void heed(self) except *
