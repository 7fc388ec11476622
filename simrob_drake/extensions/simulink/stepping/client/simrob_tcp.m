function exchange = simrob_tcp(host, port)
%SIMROB_TCP The transport of MATLAB (R2020b or newer) for SIMROB_OPEN. Not tried: there was no MATLAB.
socket = tcpclient(host, port, 'Timeout', 60, 'ConnectTimeout', 10);
configureTerminator(socket, 'LF');
exchange = @(line) ask(socket, line);
end

function answer = ask(socket, line)
writeline(socket, line);
answer = char(readline(socket));
if isempty(answer)
  error('simrob:silent', 'the server does not answer');
end
end
