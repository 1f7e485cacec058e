#!/usr/bin/env bash
# Prints an input: N masses in a row, each with a spring to the ground, a load and a law, one tone, order 7:
# chain_of_contacts.sh N [stop|slider] >chain.nml. For the growth of memory and time with the number of contacts.
set -euo pipefail
n=$1 law="type = 'elastic_stop', stiffness = 0.5, gap = 0.8"
if [ "${2:-stop}" = slider ]; then law="type = 'jenkins', stiffness = 0.5, limit = 0.2"; fi
cat <<END_OF_INPUT
&structure type = 'chain', n_masses = $n, ends = 'free', mass = 1.0, coupling_stiffness = 1.0, ground_stiffness = 1.0
   damping_mass = 0.05 /
&tones frequency = 0.9 /
&harmonics order = 7 /
END_OF_INPUT
awk -v n="$n" -v law="$law" 'BEGIN {
   for (i = 1; i <= n; i++) printf "&load dof = \"x%d\", tuple = 1, cos = %.6f /\n", i, 0.3 + 0.2*sin(0.37*i)
   for (i = 1; i <= n; i++) printf "&law dof = \"x%d\", %s /\n", i, law
}'
