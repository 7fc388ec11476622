function [outputs, time, stopped] = simrob_step(session, inputs, dt)
%SIMROB_STEP Hold inputs and go on by DT [s].
%   INPUTS and OUTPUTS are in the order of SESSION.inputs.name and SESSION.outputs.name; without INPUTS ([]) they stay.
%   STOPPED says why a monitor ended the run; it is empty while it goes on.
request = struct('do', 'step', 'dt', dt);
if ~isempty(inputs)
  request.inputs = inputs(:)';
end
answer = simrob_ask(session.exchange, request);
outputs = answer.outputs;
time = answer.time;
stopped = answer.stopped;
end
