% SPDX-License-Identifier: BSD-3-Clause
% How well models that were fitted to the first half of the hair dryer's record fit its second half, running freely:
% the best of Octave's arx and n4sid, their orders chosen on that half itself, and ours. In the working folder are
% data.m (Y, U), ours-arx.m and ours-subspace.m (A, B, C, D, u0, y0). Prints a line "NAME FIT" each, then
% how far poles and gain of the subspace are from those of n4sid.
pkg load control
source data.m
first = 1:500;
second = 501:1000;
u0 = mean(U(first));
y0 = mean(Y(first));

% Per cent, from the state at its beginning that goes best with all of it.
function percent = fit(A, B, C, D, u, y)
  observed = zeros(numel(y), rows(A));
  run = zeros(numel(y), 1);
  state = zeros(rows(A), 1);
  at = C;
  for k = 1:numel(y)
    observed(k, :) = at;
    run(k) = C * state + D * u(k);
    at = at * A;
    state = A * state + B * u(k);
  end
  run += observed * pinv(observed) * (y - run);
  percent = 100 * (1 - norm(y - run) / norm(y - mean(y)));
end

half = iddata(Y(first) - y0, U(first) - u0, 0.08);
best = [-Inf, -Inf];
for n = 1:8
  [A, B, C, D] = ssdata(n4sid(half, "s", 15, "n", n));
  if n == 4
    theirs = eig(A);
    gain = dcgain(ss(A, B, C, D, 0.08));
  end
  best(1) = max(best(1), fit(A, B, C, D, U(second) - u0, Y(second) - y0));
  for delay = 0:4
    [A, B, C, D] = ssdata(ss(arx(half, "na", n, "nb", n, "nk", delay))); % its second input is the noise
    best(2) = max(best(2), fit(A, B(:, 1), C, D(1), U(second) - u0, Y(second) - y0));
  end
end
printf("n4sid %.4f\narx %.4f\n", best);
for name = {"arx", "subspace"}
  source(["ours-", name{1}, ".m"]);
  printf("ours-%s %.4f\n", name{1}, fit(A, B, C, D, U(second) - u0, Y(second) - y0));
end
% A, B, C, D are those of our subspace. How far its poles and its gain are from those of n4sid, of 4 states as well.
apart = 0;
for pole = theirs.'
  apart = max(apart, min(abs(eig(A) - pole)) / abs(pole));
end
printf("poles %.2g\ngain %.2g\n", apart, abs(dcgain(ss(A, B, C, D, 0.08)) / gain - 1));
