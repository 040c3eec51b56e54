from rtloop.streaming.session cimport Session


cdef enum Known:
    # How much is known of the surroundings that streaming sessions use.
    ALL = 0  # Everything is known; or there is an error, and sessions are rejected.
    # Changed, and not read yet. The scene is read when the arm is at rest; a motion may continue.
    CHANGED = 1
    BEING_READ = 2  # A thread is reading it. Requests for motions wait.


cdef class ToolAndScene:
    cdef readonly object surroundings
    cdef readonly object scene_known
    cdef Known known
    cdef object _model, _info, _tool, _backend, _max_payload_kg
    cdef Session _streaming

    cdef void heed(self) except *
