"""Adds the mass of a tool to the body that carries the TCP, in the memory of MuJoCo's model.

All users of the model see the change immediately, because no memory is allocated. A simulation continues with
the same data. The mass becomes part of the body's inertia by the parallel axis theorem (Siciliano, Sciavicco,
Villani, Oriolo, "Robotics", 2009, equation B.61).
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.robot.load import moved
from cobot.robot.quaternion import from_matrix
from cobot.robot.rotations import matrix_of
from cobot.robot.tool import Tool
from cobot.types import Array, Numbers7


class Carrier:
    """The body that carries the tool, and the properties that this body has when no tool is attached.

    Attributes:
        tcp_in_flange: the TCP of the model file in the flange's frame.
        gravity: gravity of the model file in the world, m/s².
    """

    def __init__(self, mj: mujoco.MjModel, base: int, site: int) -> None:
        self._mj = mj
        self._body = int(mj.site_bodyid[site])
        self._site = site
        self.gravity: Array = np.array(mj.opt.gravity)
        self._mass = float(mj.body_mass[self._body])
        self._centre: Array = np.array(mj.body_ipos[self._body])
        self._turn: Array = np.array(mj.body_iquat[self._body])
        self._moments: Array = np.array(mj.body_inertia[self._body])
        self._sameframe = int(mj.body_sameframe[self._body])
        self._tcp: Array = np.array(mj.site_pos[site])
        self._tcp_turn: Array = np.array(mj.site_quat[site])
        self._flange, self._flange_turn = self._find_flange()
        tcp = self._flange_turn.T @ matrix_of(self._tcp_turn)
        place = self._flange_turn.T @ (self._tcp - self._flange)
        self.tcp_in_flange: Numbers7 = (*place.tolist(), *from_matrix(tcp.ravel().tolist()))

    def _find_flange(self) -> tuple[Array, Array]:
        """Position and rotation of the flange in the frame of the body that carries the TCP."""
        mj, flange = self._mj, mujoco.mj_name2id(self._mj, mujoco.mjtObj.mjOBJ_SITE, "flange")
        if flange < 0 or mj.body_weldid[mj.site_bodyid[flange]] != mj.body_weldid[self._body]:
            return self._tcp.copy(), matrix_of(self._tcp_turn)
        place, turn = np.array(mj.site_pos[flange]), matrix_of(mj.site_quat[flange])
        in_weld = self._to_weld(int(mj.site_bodyid[flange]), place, turn)
        here = self._to_weld(self._body, np.zeros(3), np.eye(3))
        return here[1].T @ (in_weld[0] - here[0]), here[1].T @ in_weld[1]

    def _to_weld(self, body: int, place: Array, turn: Array) -> tuple[Array, Array]:
        """Convert a pose from a body's frame into the frame of the body that it is welded to."""
        mj = self._mj
        while body != mj.body_weldid[body]:
            outer = matrix_of(mj.body_quat[body])
            place, turn = mj.body_pos[body] + outer @ place, outer @ turn
            body = int(mj.body_parentid[body])
        return place, turn

    def load(self, tool: Tool, gravity: Array | None) -> None:
        """Replace the tool. Call `Dynamics.settle` and `Chain.reach` afterwards.

        Args:
            gravity: gravity in the world frame, m/s²; None means the gravity of the model file.
        """
        mj, body, site = self._mj, self._body, self._site
        mj.opt.gravity[:] = self.gravity if gravity is None else gravity
        mass, centre, turn, moments = self._with(tool)
        mj.body_mass[body], mj.body_ipos[body] = mass, centre
        mj.body_iquat[body], mj.body_inertia[body] = turn, moments
        # Otherwise MuJoCo would use the body's frame for the inertia, which can only be right without a tool.
        mj.body_sameframe[body] = self._sameframe if tool.mass == 0.0 else 0
        mj.geom_sameframe[mj.geom_bodyid == body] = 0
        mj.site_sameframe[mj.site_bodyid == body] = 0
        if tool.tcp is None:
            mj.site_pos[site], mj.site_quat[site] = self._tcp, self._tcp_turn
        else:
            tip = self._flange_turn @ matrix_of(np.array(tool.tcp[3:]) / np.linalg.norm(tool.tcp[3:]))
            mj.site_pos[site] = self._flange + self._flange_turn @ tool.tcp[:3]
            mj.site_quat[site] = from_matrix(tip.ravel().tolist())

    def _with(self, tool: Tool) -> tuple[float, Array, Array, Array]:
        """Mass, centre, principal axes and principal moments of the body and the tool together."""
        if tool.mass == 0.0:
            return self._mass, self._centre, self._turn, self._moments
        place = self._flange + self._flange_turn @ tool.centre
        mass = self._mass + tool.mass
        centre = (self._mass * self._centre + tool.mass * place) / mass
        axes = matrix_of(self._turn)
        inertia = axes @ np.diag(self._moments) @ axes.T + moved(self._mass, self._centre - centre)
        inertia += self._flange_turn @ tool.inertia_matrix @ self._flange_turn.T
        inertia += moved(tool.mass, place - centre)
        moments, axes = np.linalg.eigh(inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        return mass, centre, np.array(from_matrix(axes.ravel().tolist())), moments
