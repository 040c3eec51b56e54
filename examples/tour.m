% The ten-minute tour with MATLAB. Start `make run` in a terminal, then run in MATLAB:
%     run examples/tour
URL = getenv('COBOT_URL');
if isempty(URL), URL = 'http://localhost:8007'; end
T_READ = 10;
T_MOVE = 100;
readOpts = weboptions('Timeout', T_READ);
moveOpts = weboptions('MediaType', 'application/json', 'Timeout', T_MOVE);
here = fileparts(mfilename('fullpath'));

% 1. Where is the arm? Angles in rad, velocities in rad/s, efforts in N m
jointState = webread([URL '/robot/joint_states'], readOpts);
disp(jointState.position)

% 2. Where is the TCP? Metres in base_link, and the KUKA angles A, B, C
pose = webread([URL '/robot/pose'], readOpts);
fprintf('TCP: x=%.3f, y=%.3f, z=%.3f m\n', pose.position.x, pose.position.y, pose.position.z);

% 3. Which positions have names?
positions = webread([URL '/robot/positions'], readOpts);
for i = 1:numel(positions)
  fprintf('%s - %s\n', positions(i).name, positions(i).description);
end

% 4. Go home, at half speed. The response comes when the arm has arrived
reply = webwrite([URL '/robot/move/named'], struct('name', 'home', 'speed', 0.5), moveOpts);
assert(reply.success, reply.message)

% 5. Move the joints
body = struct('joints', [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], 'speed', 0.5);
reply = webwrite([URL '/robot/move/joints'], body, moveOpts);
assert(reply.success, reply.message)

% 6. Move the TCP: first to a point, then down a straight line, then along an arc
target = struct('x', 0.45, 'y', 0.0, 'z', 0.55, 'b', pi, 'speed', 0.5);
reply = webwrite([URL '/robot/move/pose'], target, moveOpts);
assert(reply.success, reply.message)
target.z = 0.45;
target.planner = 'lin';
reply = webwrite([URL '/robot/move/pose'], target, moveOpts);
assert(reply.success, reply.message)
target.y = 0.2;
target.planner = 'circ';
target.via = struct('x', 0.5, 'y', 0.1, 'z', 0.45);
reply = webwrite([URL '/robot/move/pose'], target, moveOpts);
assert(reply.success, reply.message)

% 7. Impossible motions: the response gives the reason, and nothing moves
reply = webwrite([URL '/robot/move/pose'], struct('x', 3.0, 'y', 0.0, 'z', 0.5), moveOpts);
disp(reply.message)

% 8. Send your own trajectory, as JSON and as CSV. It runs while you read the log
reply = webwrite([URL '/robot/move/named'], struct('name', 'home', 'speed', 0.5), moveOpts);
assert(reply.success, reply.message)
home = [0, 0, 0, -1.57, 0, 1.57, 0];
p1 = struct('positions', home, 'time_from_start', 0.0);
p2 = struct('positions', [0, 0.3, 0, -1.2, 0, 1.3, 0], 'time_from_start', 2.0);
p3 = struct('positions', home, 'time_from_start', 4.0);
trajectory = struct();
trajectory.points = [p1, p2, p3];
reply = webwrite([URL '/trajectory/send'], trajectory, moveOpts);
disp(reply.status)
pause(6)
form = matlab.net.http.io.MultipartFormProvider('file', ...
    matlab.net.http.io.FileProvider(fullfile(here, 'trajectory.csv')));
request = matlab.net.http.RequestMessage('post', [], form);
response = request.send(matlab.net.URI([URL '/trajectory/send_csv?separator=%2C&retime=true']));
disp(response.Body.Data)

% 9. Stop: the arm stops on its path
reply = webwrite([URL '/stop'], struct(), moveOpts);
disp(reply.message)

% 10. Run a sequence. It runs in its own process
form = matlab.net.http.io.MultipartFormProvider( ...
    'config', matlab.net.http.io.FileProvider(fullfile(here, 'motion_sequence_config.json')), ...
    'n_iterations', '1', 'delay_between_iterations', '0');
request = matlab.net.http.RequestMessage('post', [], form);
response = request.send(matlab.net.URI([URL '/sequences/start']));
disp(response.Body.Data)
status = webread([URL '/sequences/status'], readOpts);
while ~strcmp(status.status, 'finished')
  pause(0.2)
  status = webread([URL '/sequences/status'], readOpts);
end
disp(status)
assert(status.returncode == 0, 'the sequence has failed, see /sequences/logs')

% What is the state of the robot?
health = webread([URL '/health'], readOpts);
disp(health.status)
