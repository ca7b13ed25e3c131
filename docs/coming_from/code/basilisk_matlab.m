% A spacecraft hub that tumbles freely for 10 minutes: MATLAB
moments = [900; 800; 600];            % kg m^2
omega = [0.01; 0.05; 0.001];          % rad/s
options = odeset('RelTol', 1e-11, 'AbsTol', 1e-12);
[t, y] = ode45(@(t, y) rates(y, moments), [0 600], [1; 0; 0; 0; omega], options);
attitude = y(end, 1:4) / norm(y(end, 1:4))
omega = y(end, 5:7)

function dy = rates(y, moments)       % quaternion body to space, scalar first; omega in body axes
    q = y(1:4);
    w = y(5:7);
    dq = 0.5 * [-q(2:4)' * w; q(1) * w + cross(q(2:4), w)];
    dy = [dq; cross(moments .* w, w) ./ moments];
end
