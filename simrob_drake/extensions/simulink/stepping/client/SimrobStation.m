classdef SimrobStation < matlab.System
%SIMROBSTATION A station of `simrob serve` as a MATLAB System block. Not tried: there was no MATLAB.
%   It simulates by interpreted execution. Its input is the vector of all inputs, its output that of all outputs.

  properties (Nontunable)
    Host = '127.0.0.1'
    Port = 8300
    Token = ''
    SampleTime = 1e-3
    Outputs = 1        % how many the station has: numel(session.outputs.name)
    Parameters = {}    % rows of name and value
  end

  properties (Access = private)
    Session
    Values
  end

  methods (Access = protected)
    function setupImpl(obj)
      obj.Session = simrob_open(simrob_tcp(obj.Host, obj.Port), obj.Token);
    end

    function resetImpl(obj)
      rows = reshape(obj.Parameters, [], 2);
      obj.Values = simrob_reset(obj.Session, rows);
    end

    function outputs = stepImpl(obj, inputs)
      outputs = obj.Values;  % of now; the inputs act from now on
      obj.Values = simrob_step(obj.Session, inputs, obj.SampleTime);
    end

    function sampling = getSampleTimeImpl(obj)
      sampling = createSampleTime(obj, 'Type', 'Discrete', 'SampleTime', obj.SampleTime);
    end

    function size = getOutputSizeImpl(obj)
      size = [obj.Outputs, 1];
    end

    function type = getOutputDataTypeImpl(~)
      type = 'double';
    end

    function complex = isOutputComplexImpl(~)
      complex = false;
    end

    function fixed = isOutputFixedSizeImpl(~)
      fixed = true;
    end
  end
end
