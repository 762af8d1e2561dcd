% Give the operators of a case to NLvib (MATLAB), and follow its forced response.
%
%     delam-fem show operators soft.toml -o soft.mat
%     >> to_nlvib('soft.mat', 2.6, 3.05, 5)
%
% NLvib (University of Stuttgart, https://www.ila.uni-stuttgart.de/nlvib) must be on the path: its
% SRC and SRC/MechanicalSystems. NOT RUN by the authors of this file, who have no MATLAB: written
% after the interface of NLvib 1.3. Contact is the law "penalty" without damping. The unknowns are
% seen from the base, w = u - q_b, and the load of the base is that of q_b = A sin(Om t):
%
%     f = Re(F exp(i Om t)),   F = -A Om c - i A Om^2 m,   m = m_b + M iota,   c = c_b + C iota

function [X, frequencies] = to_nlvib(file, from, to, stiffness)
    d = load(file);
    iota = -d.K \ d.k_b;
    assert(max(abs(d.H * iota)) < 1e-6, 'the base opens the gaps: laminae must be apart');
    m = d.m_b + d.M * iota;
    c = d.c_b + d.C * iota;
    springs = cell(1, size(d.H, 1));
    for k = 1:numel(springs)  % NLvib: a force stiffness * (w'q - gap) where w'q > gap
        springs{k} = struct('type', 'unilateralSpring', 'stiffness', stiffness, ...
            'gap', d.g0(k), 'force_direction', -d.H(k, :)', ...
            'islocal', true, 'ishysteretic', false);
    end
    load_of = @(Om) -d.drive_amplitude * (Om * c + 1i * Om^2 * m);
    H = 12;
    N = 2^10;
    start = 2 * pi * from;
    Q1 = (-start^2 * d.M + 1i * start * d.C + d.K) \ load_of(start);
    n = numel(Q1);
    y0 = zeros((2 * H + 1) * n, 1);
    y0(n + (1:2 * n)) = [real(Q1); -imag(Q1)];
    scale = struct('Dscale', [1e-2 * ones(size(y0)); start], 'jac', 'none');
    X = solve_and_continue(y0, @residual, start, 2 * pi * to, 0.05, scale);
    frequencies = X(end, :) / (2 * pi);

    function r = residual(x)
        % The load depends on Om, so the Jacobian is left to finite differences ('jac', 'none').
        system = MechanicalSystem(d.M, d.C, d.K, springs, load_of(x(end)));
        r = HB_residual(x, system, H, N, 'FRF');
    end
end
