"""The role that each rosbridge operation requires. A service call also requires the role of the service."""

from __future__ import annotations

from app.rosbridge import operations as op
from cobot.access.roles import Role

ROLES: dict[type[op.Operation], Role] = {
    # Operations that affect only the client itself and the messages it receives.
    op.Subscribe: Role.OBSERVER,
    op.Unsubscribe: Role.OBSERVER,
    op.Fragment: Role.OBSERVER,
    op.Status: Role.OBSERVER,
    op.SetLevel: Role.OBSERVER,
    op.Gateway: Role.OBSERVER,
    op.CallService: Role.OBSERVER,
    # Operations that affect others: the arm follows /ROBOT/joint_cmd, and programs react to other topics.
    op.Advertise: Role.OPERATOR,
    op.Unadvertise: Role.OPERATOR,
    op.Publish: Role.OPERATOR,
    op.AdvertiseService: Role.OPERATOR,
    op.UnadvertiseService: Role.OPERATOR,
    op.ServiceResponse: Role.OPERATOR,
    op.AdvertiseAction: Role.OPERATOR,
    op.UnadvertiseAction: Role.OPERATOR,
    op.ActionFeedback: Role.OPERATOR,
    op.ActionResult: Role.OPERATOR,
    op.SendActionGoal: Role.OPERATOR,
    op.CancelActionGoal: Role.OPERATOR,
}
