#!/usr/bin/env bash
# Makes large_joint.h5, the lap joint of lap_joint.sh with more elements, and the joint under one tone, joint.nml, and two,
# two_tones.nml, in a folder: large_joint.sh N_X N_Y [FOLDER [plane|whole]]; elements along and across each bar. 30 11 has 483 pairs of
# nodes. With `plane` pairs may slide in all directions, and plane.nml, of two tones, shakes the joint along and across. With
# `whole` nothing is reduced, and joint.nml, of order 7, is for the whole model, parts.h5.
set -euo pipefail
n_x=$1 n_y=$2 kept=joint.x,joint.z,upper_shaker.x
if [ "${4:-}" = plane ]; then kept+=,joint.y,upper_shaker.y; fi
cd "${3:-.}"
bar=(--length 0.12 --width 0.03 --height 0.01 --n-x "$n_x" --n-y "$n_y" --n-z 1 --overwrite)
nhbm-model solid "${bar[@]}" --clamped left --node-set 'bolt=0.1,0.015,0' --output lower.h5
nhbm-model solid "${bar[@]}" --clamped right --node-set 'bolt=0.02,0.015,0.01' --node-set 'shaker=0,0.015,0.01' --output upper.h5
nhbm-model assemble lower=lower.h5 upper=upper.h5 --at upper=0.08,0,0.01 --pair joint=lower_top,upper_bottom --partial \
   --load bolt=lower_bolt.z:1,upper_bolt.z:-1 --output parts.h5 --overwrite
if [ "${4:-}" = whole ]; then
   cat >joint.nml <<'END_OF_INPUT'
&structure type = 'model', file = 'parts.h5', damping_stiffness = 4.0e-6 /
&tones frequency = 6000.0 /
&harmonics order = 7 /
&load vector = 'bolt', tuple = 0, cos = 1000.0 /
&load dof = 'upper_shaker.x', tuple = 1, cos = 1400.0 /
&law type = 'jenkins', label = 'joint', dofs = 'joint_1.x', 'joint_2.x', weights = 1.0, -1.0, stiffness = 1.0e6
   friction_coefficient = 0.3, normal_dofs = 'joint_1.z', 'joint_2.z', normal_weights = 1.0, -1.0, normal_stiffness = 1.0e6
   preload = 0.0 /
END_OF_INPUT
   exit
fi
nhbm-model reduce parts.h5 --keep $kept --modes 30 --up-to 40000 --output large_joint.h5 --overwrite
cat >joint.nml <<'END_OF_INPUT'
&structure type = 'model', file = 'large_joint.h5', damping_stiffness = 4.0e-6 /
&tones frequency = 6000.0 /
&harmonics order = 5 /
&load vector = 'bolt', tuple = 0, cos = 1000.0 /
&load dof = 'upper_shaker.x', tuple = 1, cos = 1400.0 /
&law type = 'jenkins', label = 'joint', dof = 'joint.x', stiffness = 1.0e6, friction_coefficient = 0.3
   normal_dofs = 'joint.z', normal_stiffness = 1.0e6, preload = 0.0 /
END_OF_INPUT
sed -e 's/6000.0 /6000.0, 8485.281374 /' -e 's/order = 5/order = 2/' -e 's/tuple = 0,/tuple = 0, 0,/' \
   -e '/shaker/{s/tuple = 1, cos = 1400.0/tuple = 1, 0, cos = 700.0/;p;s/tuple = 1, 0/tuple = 0, 1/}' joint.nml >two_tones.nml
if [ "${4:-}" = plane ]; then
   sed -e "s/'jenkins'/'jenkins_2d'/" -e "s/dof = 'joint.x',/dof = 'joint.x', second_dofs = 'joint.y',/" \
      -e "/tuple = 0, 1/{s/shaker.x/shaker.y/;s/700.0/300.0/}" two_tones.nml >plane.nml
fi
