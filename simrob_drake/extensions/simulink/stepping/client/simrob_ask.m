function answer = simrob_ask(exchange, line)
%SIMROB_ASK Send a line to `simrob serve` and return what it answers; what the server refuses is an error.
if ~ischar(line)
  line = jsonencode(line);
end
answer = jsondecode(exchange(line));
if isfield(answer, 'error')
  error('simrob:refused', '%s', answer.error);
end
end
