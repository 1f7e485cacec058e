!> Properties of the linear part of the balance that laws and solvers need: stiffness at a law, scales, rounding.
submodule (hb_balance) hb_balance_linear
   use hb_dynamic_stiffness, only: chunk_of_columns
   use hb_thresholds, only: equality_tolerance
   implicit none

contains

   !> Passes structural data at the first coordinate of law i, a multiplier, to the law: the stiffness 1/|w.S^-1 w| in the first
   !> harmonic in which the structure cannot move freely (the static one, unless the set has no zero tuple or the
   !> structure no support), and the impedance, this stiffness over |j.omega| in the fastest harmonic.
   module procedure prepare_multiplier
      integer :: fastest
      real(wp) :: compliance, mobility

      associate (law => self%law_set%laws(i)%law)
         compliance = self%compliance_of_law(i)
         if (compliance > 0.0_wp) call law%prepare(1.0_wp/compliance)
         fastest = maxloc(abs(self%frequencies), dim=1)
         associate (frequency => abs(self%frequencies(fastest)))
            mobility = frequency*self%stiffness%compliance(law%dofs, law%shape(:, 1), fastest)
            if (mobility > 0.0_wp) call law%prepare_rate(1.0_wp/mobility, frequency)
         end associate
      end associate
   end procedure prepare_multiplier

   module procedure balance_compliance_of_law

      associate (law => self%law_set%laws(i)%law)
         compliance = self%stiffness%compliance(law%dofs, law%shape(:, 1))
      end associate
   end procedure balance_compliance_of_law

   !> Scales of unknowns and equations, one each per degree of freedom: linear motion and loads; if these vanish, gaps
   !> and the forces at rest.
   module procedure choose_scales
      real(wp) :: motion(self%n_dofs), load(self%n_dofs), r(self%n_unknowns)
      integer :: i

      call self%stiffness%find_scales(self%harmonics, motion, load)
      if (maxval(load) <= 0.0_wp) then                                ! no loads: forces of the laws at rest
         call self%residual([(0.0_wp, i=1, size(r))], r)
         load = norm2(reshape(r, [self%harmonics%n_coefficients, self%n_dofs]), dim=1)
      end if
      if (maxval(motion) <= 0.0_wp) then
         do i = 1, size(self%law_set%laws)
            motion = max(motion, self%law_set%laws(i)%law%length_scale)
         end do
      end if
      if (maxval(motion) <= 0.0_wp) motion = 1.0_wp
      if (maxval(load) <= 0.0_wp) load = self%stiffness%largest_entry()*motion
      if (maxval(load) <= 0.0_wp) load = 1.0_wp
      where (motion <= epsilon(1.0_wp)*maxval(motion)) motion = maxval(motion)
      where (load <= epsilon(1.0_wp)*maxval(load)) load = maxval(load)
      call self%set_scales(motion, load)
   end procedure choose_scales

   !> Replaces `u`, the motion without laws, by the motion of the structure with the slopes of its laws at rest,
   !> sliders stuck, if sliders slip in the former, typically far near a resonance, but none does in the latter.
   !> Otherwise `u` is unchanged.
   module procedure balance_stuck_solution
      real(wp), dimension(self%harmonics%n_coefficients, self%n_dofs) :: at_rest, stuck
      real(wp) :: r(self%n_unknowns)
      type(error_t), allocatable :: error
      integer :: i

      is_better = .false.
      if (.not. self%law_set%has_memory .or. .not. self%has_sound_scales() .or. allocated(self%stiffness%contacts)) return
      at_rest = 0.0_wp
      call self%residual([(0.0_wp, i=1, size(r))], r)
      call self%factorise_mean_tangent(at_rest, error)
      if (allocated(error)) return
      call self%solve_mean_tangent(r, stuck)
      call self%mean_factors%release()
      if (.not. all(ieee_is_finite(stuck))) return
      stuck = -stuck
      call self%sample(stuck)
      call self%law_set%evaluate()
      is_better = self%law_set%all_stick()
      if (.not. is_better) return
      call self%sample(u)
      call self%law_set%evaluate()
      is_better = .not. self%law_set%all_stick()
      if (is_better) u = stuck
   end procedure balance_stuck_solution

   module procedure balance_rounding_level

      level = rounding_level_of(self, x)
   end procedure balance_rounding_level

   !> A few units in the last place of the largest terms of each equation: |F_ext| + |S| |u|, and the effect of an
   !> error of one unit in the motion on the forces of stiff laws. If frequencies change, the condensation has
   !> different rounding errors at each of them: units in the last place of the stiffness before the interior is
   !> eliminated, and of stiffness and inertia, which cancel at a resonance. Above `equality_tolerance` a point counts as failed,
   !> not as rounded.
   real(wp) function rounding_level_of(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), parameter :: lu_rounding = 64.0_wp*epsilon(1.0_wp)     ! elimination amplifies errors slightly
      real(wp), parameter :: few_units = 4.0_wp*epsilon(1.0_wp)        ! of K - w**2 M alone
      type(error_t), allocatable :: error
      complex(wp) :: columns(self%n_dofs, chunk_of_columns)
      real(wp) :: motion, of_harmonic(self%n_dofs), terms, total
      integer :: h, i, k, start

      total = 0.0_wp
      do h = 1, self%harmonics%n_harmonics
         of_harmonic = abs(self%stiffness%load(:, h))
         do start = 1, self%n_dofs, chunk_of_columns
            call self%stiffness%get_columns(start, h, columns(:, :min(chunk_of_columns, self%n_dofs - start + 1)))
            do k = start, min(start + chunk_of_columns - 1, self%n_dofs)
               motion = abs(self%harmonics%amplitude(u(:, k), h))
               associate (first => self%stiffness%pattern%first(k), last => self%stiffness%pattern%last(k))
                  of_harmonic(first:last) = of_harmonic(first:last) + abs(columns(first:last, k - start + 1))*motion
               end associate
            end do
         end do
         do i = 1, self%n_dofs
            total = total + (of_harmonic(i)/scale_of(i))**2
         end do
      end do
      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) then                                ! without memory the first part must suffice
         associate (jacobian => self%law_set%jacobian)
            do i = 1, jacobian%n_pairs
               associate (slope => jacobian%df_dq%values(:, i), q => self%law_set%samples%q%values(:, jacobian%column(i)))
                  terms = norm2(slope)/sqrt(real(size(slope), wp))*maxval(abs(q))
               end associate
               total = total + (self%law_set%factor*terms/scale_of(jacobian%row(i)))**2
            end do
         end associate
         if (self%law_set%has_memory) total = total + sum((self%law_set%factor*self%law_set%spring_forces() &
                                                           /[(scale_of(i), i=1, self%n_dofs)])**2)
      end if
      rounding_level_of = min(equality_tolerance, lu_rounding*sqrt(total))
      if (.not. self%has_moved) return
      total = 0.0_wp
      associate (set => self%harmonics)
         do i = 1, self%n_dofs
            do h = 1, set%n_harmonics
               total = total + (self%stiffness%magnitude(i, h)*abs(set%amplitude(u(:, i), h))/scale_of(i))**2
            end do
         end do
      end associate
      rounding_level_of = min(equality_tolerance, rounding_level_of + merge(few_units, lu_rounding, &
            self%stiffness%n_dofs == self%n_dofs)* &
                              sqrt(total))

   contains

      real(wp) function scale_of(dof)
         integer, intent(in) :: dof

         scale_of = self%r_scale(1 + (dof - 1)*self%harmonics%n_coefficients)
      end function scale_of
   end function rounding_level_of
end submodule hb_balance_linear
