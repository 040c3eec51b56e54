#!/usr/bin/env bash
# The ten-minute tour with curl. Start `make run` in another terminal, then: bash examples/tour.sh
set -euo pipefail
HOST=${HOST:-http://localhost:8007}
HERE=$(cd "$(dirname "$0")" && pwd)

ask() { curl -sS --fail-with-body --max-time 90 "$@"; echo; }
# A motion answers 200 even when it could not be done: the answer's "success" says so.
move() { ask -X POST "$HOST$1" -H 'Content-Type: application/json' -d "$2" | tee /dev/stderr | grep -q '"success": *true'; }

echo '# 1. Where is the arm? Angles in rad, velocities in rad/s, efforts in N m'
ask "$HOST/robot/joint_states"

echo '# 2. Where is its tool? Metres in base_link; KUKA angles A, B, C'
ask "$HOST/robot/pose"

echo '# 3. Which positions have names?'
ask "$HOST/robot/positions"

echo '# 4. Go home, at half speed; the answer comes when the arm has arrived'
move /robot/move/named '{"name": "home", "speed": 0.5}'

echo '# 5. Move the joints'
move /robot/move/joints '{"joints": [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.5}'

echo '# 6. Move the tool: to a point first, then down a straight line, then along an arc'
move /robot/move/pose '{"x": 0.45, "y": 0.0, "z": 0.55, "b": 3.14159, "speed": 0.5}'
move /robot/move/pose '{"x": 0.45, "y": 0.0, "z": 0.45, "b": 3.14159, "speed": 0.5, "planner": "lin"}'
move /robot/move/pose '{"x": 0.45, "y": 0.2, "z": 0.45, "b": 3.14159, "speed": 0.5, "planner": "circ", "via": {"x": 0.5, "y": 0.1, "z": 0.45}}'

echo '# 7. What cannot be done says why, and nothing moves'
ask -X POST "$HOST/robot/move/pose" -H 'Content-Type: application/json' -d '{"x": 3.0, "y": 0.0, "z": 0.5}'
curl -sS -X POST "$HOST/robot/move/joints" -H 'Content-Type: application/json' -d '{"joints": [9, 0, 0, 0, 0, 0, 0]}'; echo

echo '# 8. Send a trajectory of your own, as JSON and as CSV; it runs while you read the log'
move /robot/move/named '{"name": "home", "speed": 0.5}'
sent=$(ask -X POST "$HOST/trajectory/send" -H 'Content-Type: application/json' -d '{"points": [
  {"positions": [0, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 0.0},
  {"positions": [0, 0.3, 0, -1.2, 0, 1.3, 0], "time_from_start": 2.0},
  {"positions": [0, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 4.0}]}')
echo "$sent"
motion=$(sed 's/.*"motion_id":\([0-9]*\).*/\1/' <<< "$sent")
until curl -sS "$HOST/trajectory/logs?n=5" | grep -q "motion $motion: arrived"; do sleep 0.2; done
ask -X POST "$HOST/trajectory/send_csv?separator=%2C&retime=true" -F "file=@$HERE/trajectory.csv;type=text/csv"

echo '# 9. Stop it: the arm comes to rest on its path'
ask -X POST "$HOST/stop"

echo '# 10. Run a sequence, in a process of its own'
ask -X POST "$HOST/sequences/start" -F "config=@$HERE/motion_sequence_config.json;type=application/json" \
    -F n_iterations=1 -F delay_between_iterations=0
until curl -sS "$HOST/sequences/status" | grep -q '"finished"'; do sleep 0.2; done
ask "$HOST/sequences/status"
ask "$HOST/sequences/logs?n=20"

echo '# And how is the robot?'
ask "$HOST/health"
