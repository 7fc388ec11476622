function [outputs, time] = simrob_reset(session, parameters)
%SIMROB_RESET Begin anew, with parameters.
%   OUTPUTS = SIMROB_RESET(SESSION, {'servo.kp.joint_1', 500; 'gravity', 1.62}) builds the station with these values
%   and returns its outputs at the start, in the order of SESSION.outputs.name.
if nargin < 2
  parameters = cell(0, 2);
end
pairs = cell(1, size(parameters, 1));
for row = 1:numel(pairs)
  pairs{row} = parameters(row, :);
end
answer = simrob_ask(session.exchange, struct('do', 'reset', 'parameters', {pairs}));
outputs = answer.outputs;
time = answer.time;
end
