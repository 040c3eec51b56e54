// New steps. They are complete except for names, which only the user knows.
export const PLACED = ["joints", "home", "pallet"]; // made of where the arm is

const CONDITION = { input: "", is: true };

const NEW = {
  joints: ({ joints, speed }) => ({ joints, speed }),
  home: ({ joints, speed }) => ({ joints, speed }),
  named: ({ position, speed }) => ({ named: position, speed }),
  gripper: () => ({ gripper: { command: "grasp" } }),
  set: () => ({ set: { output: "", value: true } }),
  wait_for: () => ({ wait_for: { ...CONDITION } }),
  wait_s: () => ({ wait_s: 1 }),
  repeat: () => ({ repeat: { count: 2 }, do: [] }),
  if: () => ({ if: { ...CONDITION }, then: [] }),
  call: () => ({ call: "" }),
  pallet: ({ pose }) => ({ pallet: { origin: pose, counts: [2, 2], offsets: [{ x: 0.05 }, { y: 0.05 }] }, do: [] }),
  on_error: () => ({ on_error: { retry: 1 }, do: [] }),
};

// now: {joints, pose, speed, position}; each kind uses some of them.
export const newStep = (kind, now) => NEW[kind](now);
