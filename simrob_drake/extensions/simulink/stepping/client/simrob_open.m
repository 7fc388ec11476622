function session = simrob_open(exchange, token)
%SIMROB_OPEN Begin to talk to `simrob serve`, in MATLAB or Octave.
%   SESSION = SIMROB_OPEN(EXCHANGE, TOKEN) has the names, units and values of the station's inputs, outputs and
%   parameters. EXCHANGE is a function handle that sends a line of text and returns the line that answers it, such as
%   that of SIMROB_TCP.
session = simrob_ask(exchange, token);
session.exchange = exchange;
for part = {'inputs', 'outputs', 'parameters'}
  listed = session.(part{1});
  if isempty(listed)
    listed = struct('name', {}, 'unit', {}, 'value', {});
  end
  session.(part{1}) = struct('name', {{listed.name}'}, 'unit', {{listed.unit}'}, 'value', [listed.value]');
end
end
