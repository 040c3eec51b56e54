#!/usr/bin/env bash
# The ten-minute tour with curl. Start `make run` in another terminal, then:
#     bash examples/tour.sh
set -euo pipefail
COBOT_URL=${COBOT_URL:-http://localhost:8007}
export no_proxy=*   # requests to the robot do not use a proxy
HERE=$(cd "$(dirname "$0")" && pwd)

ask() { curl -sS --fail-with-body --max-time 100 "$@"; echo; }
# If a motion fails, the status is still 200, so check "success" in the response too.
move() { ask -X POST "$COBOT_URL$1" -H 'Content-Type: application/json' -d "$2" | tee /dev/stderr | grep -q '"success": *true'; }
# Read a path until the response matches the pattern, and print the match.
wait_for() {
    for _ in {1..450}; do
        if curl -sS --max-time 10 "$COBOT_URL$1" | grep -oE "$2"; then return; fi
        sleep 0.2
    done
    echo "$1 has no $2" >&2
    return 1
}

echo '# 1. Where is the arm? Angles in rad, velocities in rad/s, efforts in N m'
ask "$COBOT_URL/robot/joint_states"

echo '# 2. Where is the TCP? Metres in base_link, and the KUKA angles A, B, C'
ask "$COBOT_URL/robot/pose"

echo '# 3. Which positions have names?'
ask "$COBOT_URL/robot/positions"

echo '# 4. Go home, at half speed. The response comes when the arm has arrived'
move /robot/move/named '{"name": "home", "speed": 0.5}'

echo '# 5. Move the joints'
move /robot/move/joints '{"joints": [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.5}'

echo '# 6. Move the TCP: first to a point, then down a straight line, then along an arc'
move /robot/move/pose '{"x": 0.45, "y": 0.0, "z": 0.55, "b": 3.14159, "speed": 0.5}'
move /robot/move/pose '{"x": 0.45, "y": 0.0, "z": 0.45, "b": 3.14159, "speed": 0.5, "planner": "lin"}'
move /robot/move/pose '{"x": 0.45, "y": 0.2, "z": 0.45, "b": 3.14159, "speed": 0.5, "planner": "circ", "via": {"x": 0.5, "y": 0.1, "z": 0.45}}'

echo '# 7. Impossible motions: the response gives the reason, and nothing moves'
ask -X POST "$COBOT_URL/robot/move/pose" -H 'Content-Type: application/json' -d '{"x": 3.0, "y": 0.0, "z": 0.5}'
curl -sS -X POST "$COBOT_URL/robot/move/joints" -H 'Content-Type: application/json' -d '{"joints": [9, 0, 0, 0, 0, 0, 0]}'; echo

echo '# 8. Send your own trajectory, as JSON and as CSV. It runs while you read the log'
move /robot/move/named '{"name": "home", "speed": 0.5}'
sent=$(ask -X POST "$COBOT_URL/trajectory/send" -H 'Content-Type: application/json' -d '{"points": [
  {"positions": [0, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 0.0},
  {"positions": [0, 0.3, 0, -1.2, 0, 1.3, 0], "time_from_start": 2.0},
  {"positions": [0, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 4.0}]}')
echo "$sent"
motion=$(sed 's/.*"motion_id":\([0-9]*\).*/\1/' <<< "$sent")
wait_for '/trajectory/logs?n=5' "motion $motion: (arrived|[^a])[^\"]*" | tee /dev/stderr | grep -q arrived
ask -X POST "$COBOT_URL/trajectory/send_csv?separator=%2C&retime=true" -F "file=@$HERE/trajectory.csv;type=text/csv"

echo '# 9. Stop: the arm stops on its path'
ask -X POST "$COBOT_URL/stop"

echo '# 10. Run a sequence. It runs in its own process'
ask -X POST "$COBOT_URL/sequences/start" -F "config=@$HERE/motion_sequence_config.json;type=application/json" \
    -F n_iterations=1 -F delay_between_iterations=0
wait_for /sequences/status '"returncode":-?[0-9]+' > /dev/null
ask "$COBOT_URL/sequences/logs?n=20"
ask "$COBOT_URL/sequences/status" | tee /dev/stderr | grep -q '"returncode":0'

echo '# What is the state of the robot?'
ask "$COBOT_URL/health"
