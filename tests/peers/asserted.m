% SPDX-License-Identifier: BSD-3-Clause
% Our subspace model of the whole hair dryer's record, around no operating point, of 4 states and 15 rows as the one that Octave's
% moen4.m asserts of itself. In the working folder are data.m (Y, U), asserted-by-octave.m (Ae, Be, Ce, De) and ours-whole.m
% (A, B, C, D). Prints how far apart are the poles; our gain and the one that least squares of the free run find with the asserted
% A and C; our gain and the asserted one, whose B is found otherwise; and those of Octave's own moen4 and moesp.
pkg load control
source data.m
source asserted-by-octave.m
source ours-whole.m
gain = @(A, B, C, D) C * ((eye(rows(A)) - A) \ B) + D;
apart = 0;
for pole = eig(Ae).'
  apart = max(apart, min(abs(eig(A) - pole)) / abs(pole));
end
run = zeros(numel(Y), 9); % what B, the state at first, and D do
at = Ce;
for j = 1:4
  x = zeros(4, 1);
  for k = 1:numel(Y)
    run(k, j) = Ce * x;
    x = Ae * x + (1:4 == j)' * U(k);
  end
end
for k = 1:numel(Y)
  run(k, 5:9) = [at, U(k)];
  at = at * Ae;
end
found = run \ Y;
free = gain(Ae, found(1:4), Ce, found(9));
whole = iddata(Y, U);
printf("poles %.2g\nfree-run-gain %.2g\nasserted-gain %.2g\nmoesp-gain %.2g\n", apart, abs(gain(A, B, C, D) / free - 1),
       abs(gain(A, B, C, D) / gain(Ae, Be, Ce, De) - 1), abs(dcgain(moesp(whole, "s", 15, "n", 4)) / gain(Ae, Be, Ce, De) - 1));
