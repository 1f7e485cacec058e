!> Continuation of one unknown tone to a limit cycle: the curve of motions with artificial damping, by arc length.
!> The curve begins at a mode with a small amplitude. Where the artificial damping changes its sign, the motion needs
!> none: a limit cycle. One beyond which the motion is damped is preferred, because it attracts nearby motions. The
!> curve may have folds in amplitude, for instance where two flexible bodies touch. Source: docs/why/theory.md,
!> section 6.5.
module hb_amplitude_curve
   use hb_curve, only: curve_config_t, curve_t, new_curve
   use hb_kinds, only: wp
   use hb_limit_cycle_search, only: first_amplitude, fundamental, last_amplitude, max_steps, &
      path_point_t, search_t
   use hb_outcome, only: outcome
   use hb_phase, only: new_phase_problem, phase_problem_t, shift_functional
   use hb_text, only: to_text
   use hb_thresholds, only: max_bisections, negligible_share, rounding_level
   implicit none
   private
   public :: begin_curve, follow_curve, point_of, step_along, update_scales

   type(curve_config_t), parameter :: steps = curve_config_t( &       ! arc length in units of the amplitude reached
      first_step=0.3_wp, longest_step=2.0_wp, shortest_step=1.0e-6_wp, kink_step=1.0e-3_wp, reduction=0.4_wp, little=0.0_wp)

   real(wp), parameter :: largest_damping = 100.0_wp                  ! xi/omega: permanently damped; without this limit
                                                                      ! inputs/rotor_stator/rotating.nml takes four times as long

contains

   !> Searches for a limit cycle, from the base motion until the curve is far from it, strongly damped, or back there.
   !> Without success the search contains the largest amplitude, and a message if the curve was lost.
   subroutine follow_curve(self, point, is_found)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(out) :: point                         !! the motion found, otherwise the last point
      logical, intent(out) :: is_found
      type(curve_t) :: curve
      type(path_point_t) :: crossing                                  ! the first unstable limit cycle
      type(path_point_t) :: last
      real(wp) :: damping(1), damping_before(1)
      integer :: i
      logical :: is_on_curve

      is_found = .false.
      call self%begin(self%length*first_amplitude, point, is_on_curve)
      if (.not. is_on_curve) return
      damping = self%damping(point)
      self%is_neutral = abs(damping(1)) <= rounding_level
      self%is_driven = damping(1) < -rounding_level
      self%reached = point%amplitude(1)
      call begin_curve(self, point, curve)
      do i = 1, max_steps
         last = point
         call step_along(self, curve, point)
         if (curve%status /= outcome%pending) exit
         if (sum((point%u - self%base%u)*(last%u - self%base%u)) < 0.0_wp) exit   ! through the base motion: another mode ends here
         damping_before = damping
         damping = self%damping(point)
         self%is_neutral = self%is_neutral .and. abs(damping(1)) <= rounding_level
         self%is_driven = self%is_driven .or. damping(1) < -rounding_level
         self%reached = max(self%reached, point%amplitude(1))
         if (damping(1)*damping_before(1) <= 0.0_wp .and. .not. self%is_neutral) call find_motion_on_step()
         if (is_found) exit
         if (point%amplitude(1) > last_amplitude*self%length .or. damping(1) > largest_damping) exit
         if (point%amplitude(1) < 0.1_wp*first_amplitude*self%length .and. point%amplitude(1) < last%amplitude(1)) exit
         call update_scales(self, curve, point)
         call curve%turn()
      end do
      call self%report%add(curve%report)
      if (is_found) return
      if (allocated(crossing%u)) then
         point = crossing
         call self%try_motion(point, is_found)
         self%is_left = is_found
         if (is_found) self%message = "unstable limit cycle: motions below it decay, motions above it grow"
         if (is_found) return
      end if
      call report_end(self, point, damping(1), i <= max_steps .and. curve%status == outcome%pending)

   contains

      !> Finds the limit cycle on the last step, where no damping is needed: the wanted one if the damping rises there; of the
      !> others, which are unstable, the first is kept.
      subroutine find_motion_on_step()
         type(path_point_t) :: motion
         logical :: is_stable, is_there

         is_stable = damping(1) > damping_before(1)
         if (.not. is_stable .and. allocated(crossing%u)) return
         motion = last
         call correct_at_value(self, curve, motion, is_there)
         if (.not. is_there) return
         is_found = is_stable
         if (is_stable) point = motion
         if (.not. is_stable) crossing = motion
      end subroutine find_motion_on_step
   end subroutine follow_curve

   !> Describes where a curve without a motion has ended.
   subroutine report_end(self, point, damping, is_whole)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(in) :: point                          !! the last one
      real(wp), intent(in) :: damping                                  !! there
      logical, intent(in) :: is_whole                                  !! it was followed to its end

      if (is_whole) then
         if (.not. self%is_driven) return
         self%message = "self-excited up to an amplitude of "//to_text(self%reached)
         self%runs_away = damping < -rounding_level .and. point%amplitude(1) > last_amplitude*self%length
         if (self%runs_away) then
            self%message = self%message//": the motion grows without bound"
         else
            self%message = self%message//", where no motion was found: it may grow without bound"
         end if
         return
      end if
      self%report%status = outcome%stalled
      self%message = "continuation to the motion failed at amplitude "//to_text(point%amplitude(1))//" and damping xi/omega "// &
                     to_text(point%xi(1)/point%omega(1))
   end subroutine report_end

   !> Takes one step along the curve. Steps with a large change of the frequency, which may lead to another piece of
   !> the curve, or to the same motion counted as a higher harmonic, are rejected and shortened.
   subroutine step_along(self, curve, point)
      type(search_t), intent(in) :: self
      type(curve_t), intent(inout) :: curve
      type(path_point_t), intent(inout) :: point                       !! start of the step, on return its end
      real(wp), parameter :: largest_ratio = 1.5_wp
      type(path_point_t) :: next
      integer :: h

      h = fundamental(self%balance%harmonics, self%tones(1))
      do
         call curve%advance()
         if (curve%status /= outcome%pending) return
         next = point_of(self, curve%x)
         associate (set => self%balance%harmonics, ratio => next%omega(1)/point%omega(1))
            if (max(ratio, 1.0_wp/ratio) <= largest_ratio .and. next%amplitude(1) > 0.0_wp .and. &
                norm2(next%u([set%cos_at(h), set%sin_at(h)], :)) >= negligible_share*norm2(next%u - self%base%u)) exit
         end associate
         call curve%retreat()
      end do
      point = next
   end subroutine step_along

   !> Creates the curve from its first point on, initially towards a larger amplitude of the same shape.
   subroutine begin_curve(self, point, curve)
      type(search_t), intent(inout) :: self
      type(path_point_t), intent(in) :: point
      type(curve_t), intent(out) :: curve
      type(phase_problem_t) :: problem
      real(wp), allocatable :: upwards(:)
      logical :: is_possible

      upwards = [reshape(point%u - self%base%u, [size(point%u)]), 0.0_wp, 0.0_wp]
      call self%move_balance(point, is_possible)
      call self%set_scales(point%amplitude(1))
      call new_phase_problem(problem, self%balance, self%tones, .true., phase_functionals(self, point), [0.0_wp, 0.0_wp])
      call new_curve(curve, problem%bordered_problem_t, [point%u, point%omega, point%xi], upwards, units_of(point), steps, &
                     self%path_config())
   end subroutine begin_curve

   !> Updates scales, units and the phase condition to the present point.
   subroutine update_scales(self, curve, point)
      type(search_t), intent(inout) :: self
      type(curve_t), intent(inout) :: curve
      type(path_point_t), intent(in) :: point

      call self%set_scales(point%amplitude(1))
      curve%problem%functionals = phase_functionals(self, point)
      curve%units = units_of(point)
   end subroutine update_scales

   !> The phase condition, and memory for the plane normal to the curve.
   function phase_functionals(self, point) result(functionals)
      type(search_t), intent(in) :: self
      type(path_point_t), intent(in) :: point
      real(wp), allocatable :: functionals(:, :)

      allocate (functionals(size(point%u) + 2, 2), source=0.0_wp)
      functionals(:size(point%u), 1) = shift_functional(self%balance%harmonics, self%tones(1), point%u, &
                                                        reshape(self%balance%x_scale, shape(point%u)))
   end function phase_functionals

   !> Units of the arc length: the amplitude for coefficients, the frequency for itself and for the damping unless
   !> that is larger.
   pure function units_of(point) result(units)
      type(path_point_t), intent(in) :: point
      real(wp) :: units(size(point%u) + 2)

      units(:size(point%u)) = point%amplitude(1)
      units(size(point%u) + 1) = point%omega(1)
      units(size(point%u) + 2) = max(point%omega(1), abs(point%xi(1)))
   end function units_of

   !> The motion of a vector of unknowns.
   pure function point_of(self, x) result(point)
      type(search_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      type(path_point_t) :: point
      integer :: h, n

      n = size(x) - 2
      associate (set => self%balance%harmonics)
         allocate (point%u, source=reshape(x(:n), [set%n_coefficients, self%balance%n_dofs]))
         allocate (point%omega, source=[x(n + 1)])
         allocate (point%xi, source=[x(n + 2)])
         h = fundamental(set, self%tones(1))
         allocate (point%amplitude, source=[maxval(hypot(point%u(set%cos_at(h), :), point%u(set%sin_at(h), :)))])
      end associate
   end function point_of

   !> Finds the limit cycle on the step on which the damping changed its sign, and tries it without artificial damping
   !> as early as possible.
   subroutine correct_at_value(self, curve, from, is_found)
      type(search_t), intent(inout) :: self
      type(curve_t), intent(inout) :: curve
      type(path_point_t), intent(inout) :: from                        !! start of the step, on return the motion found
      logical, intent(out) :: is_found
      type(path_point_t) :: middle, trial
      real(wp) :: high, low, x(size(curve%x))
      integer :: i
      logical :: is_on_curve

      low = 0.0_wp
      high = curve%last%step
      do i = 1, max_bisections
         call self%set_scales(from%amplitude(1))
         call curve%point_at(0.5_wp*(low + high), x, is_on_curve)
         middle = from
         if (is_on_curve) middle = point_of(self, x)
         trial = middle
         if (abs(middle%xi(1)) <= 0.1_wp*0.3_wp**i*middle%omega(1) .or. modulo(i, 4) == 0) then
            call self%try_motion(trial, is_found)
            if (is_found) is_found = abs(log(trial%omega(1)/middle%omega(1))) < 0.1_wp
            if (is_found) then
               from = trial
               return
            end if
         end if
         if (.not. is_on_curve) exit
         if (middle%xi(1)*from%xi(1) > 0.0_wp) then
            low = 0.5_wp*(low + high)
         else
            high = 0.5_wp*(low + high)
         end if
      end do
      is_found = .false.
   end subroutine correct_at_value
end module hb_amplitude_curve
