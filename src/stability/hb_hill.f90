!> How many disturbances of a periodic motion grow, of structures with parts whose stiffness depends on the frequency: delays.
!>
!> A disturbance exp(lambda t) times a function of the period has harmonics at s_k = lambda + i k omega, coupled by the slopes of
!> the laws along the motion. Hill's determinant f of their equations, divided by a power of s_k + a for each row, has the
!> period i omega in lambda, no poles where Re(lambda) > -a, and is constant for large Re(lambda). By the principle of the argument
!> its zeros with Re(lambda) > sigma, one for each such disturbance, are the turns of f along one period of the line at sigma.
!> Source: G. W. Hill, Acta Mathematica 8 (1886) 1-36; H. Nyquist, Bell System Technical Journal 11 (1932) 126-147.
module hb_hill
   use hb_cancellation, only: work_is_over
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: zgetrf
   use hb_stability, only: stability_method, stability_t, verdict
   use hb_structure, only: structure_t
   use hb_variation, only: piece_t, variation_t
   implicit none
   private
   public :: assess_by_hill, has_determinant, work_of_hill

   real(wp), parameter :: growth_margins(*) = [2.0e-2_wp, 5.0e-3_wp]  ! of growth rates, relative to the frequency
   real(wp), parameter :: margins_given(*) = [2.0e-2_wp, 2.0e-3_wp, 2.0e-4_wp] ! likewise, of a given frequency: no exponent is zero
   real(wp), parameter :: max_turn_defect = 0.1_wp                    ! distance of the turns from a whole number
   real(wp), parameter :: longest_turn = two_pi/8                     ! of f from one point of the line to the next
   integer, parameter :: first_points = 24, max_points = 2000         ! of the line
   integer, parameter :: extra_harmonics = 8                          ! harmonics beyond those of the motion, at least
   integer, parameter :: samples_of_harmonic = 8
   integer, parameter :: usual_points = 60

   type :: hill_t
      integer :: n_dofs = 0, order = 0
      real(wp) :: omega = 0.0_wp                                      !! [rad/s]
      real(wp) :: offset = 0.0_wp                                     !! a [1/s]
      integer :: degree = 0                                           !! of the determinant of a harmonic in s_k
      type(structure_t) :: structure
      complex(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :)   !! (n_dofs, n_dofs, -2 order:2 order), harmonics
   end type hill_t

contains

   !> Verdict on a motion of one tone, if all turns are whole and no exponent is next to the imaginary axis.
   subroutine assess_by_hill(self, variation, structure, is_free)
      type(stability_t), intent(inout) :: self
      type(variation_t), intent(inout) :: variation                   !! of the structure without its parts
      type(structure_t), intent(in) :: structure
      logical, intent(in) :: is_free                                  !! the tone is unknown: one exponent is zero
      type(hill_t) :: hill
      real(wp), allocatable :: margin(:)
      integer :: above, i, n_neutral, right
      logical :: is_whole

      call new_hill(hill, variation, structure)
      self%method = stability_method%integration
      allocate (margin, source=margins_given)
      if (is_free) margin = growth_margins
      n_neutral = merge(1, 0, is_free)
      do i = 1, size(margin)
         call count_growing(hill, margin(i)*hill%omega, right, is_whole)
         if (.not. is_whole) return
         if (right > 0) then
            self%n_unstable = right
            self%verdict = verdict%unstable
            return
         end if
         call count_growing(hill, -margin(i)*hill%omega, above, is_whole)
         if (.not. is_whole) return
         if (above /= n_neutral) cycle
         self%verdict = verdict%stable
         return
      end do
   end subroutine assess_by_hill

   !> Whether all parts have a stiffness for growing motions, without poles next to the imaginary axis.
   pure logical function has_determinant(parts, omega) result(has)
      type(frequency_part_t), intent(in) :: parts(:)
      real(wp), intent(in) :: omega                                   !! [rad/s]
      integer :: i

      has = .true.
      do i = 1, size(parts)
         select case (parts(i)%kind)
         case (kind_of_part%delay)
         case (kind_of_part%maxwell)
            has = has .and. all(2.0_wp*maxval(growth_margins)*omega*parts(i)%times < 1.0_wp)
         case default
            has = .false.
         end select
      end do
   end function has_determinant

   !> Approximate work in nanoseconds.
   pure real(wp) function work_of_hill(variation) result(work)
      type(variation_t), intent(in) :: variation
      real(wp) :: n

      n = real(variation%n_dofs, wp)*(2*order_of(variation) + 1)
      work = 4.0_wp*usual_points*n**2*(n/3.0_wp + 20.0_wp)
   end function work_of_hill

   pure integer function order_of(variation)
      type(variation_t), intent(in) :: variation

      associate (highest => maxval(abs(variation%motion%tuples)))
         order_of = highest + max(extra_harmonics, highest/2)
      end associate
   end function order_of

   !> Slopes along the motion as harmonics, and what divides the determinant.
   subroutine new_hill(self, variation, structure)
      type(hill_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      type(structure_t), intent(in) :: structure
      type(piece_t) :: piece
      complex(wp) :: factor
      real(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :), by_state(:, :, :), phases(:)
      integer :: i, k, n, n_samples

      n = variation%n_dofs
      self%n_dofs = n
      self%order = order_of(variation)
      self%omega = variation%motion%omega(1)
      self%structure = structure
      self%offset = self%omega
      do i = 1, n
         if (any(abs(structure%mass(i, :)) > 0.0_wp)) then
            self%degree = self%degree + 2
         else if (any(abs(structure%damping(i, :)) > 0.0_wp)) then
            self%degree = self%degree + 1
         end if
      end do
      n_samples = samples_of_harmonic*2*self%order
      allocate (by_displacement(variation%n_coordinates, variation%n_coordinates, n_samples))
      allocate (by_rate, mold=by_displacement)
      allocate (by_state(variation%n_coordinates, variation%n_states, n_samples))
      phases = [(two_pi*i/n_samples, i=0, n_samples - 1)]
      call variation%find_slopes(piece, phases/self%omega, by_displacement, by_rate, by_state)
      allocate (self%by_displacement(n, n, -2*self%order:2*self%order), self%by_rate(n, n, -2*self%order:2*self%order), &
                source=(0.0_wp, 0.0_wp))
      do k = -2*self%order, 2*self%order
         do i = 1, n_samples
            factor = exp(cmplx(0.0_wp, -k*phases(i), wp))/n_samples
            self%by_displacement(:, :, k) = self%by_displacement(:, :, k) + factor*at_dofs(by_displacement(:, :, i))
            self%by_rate(:, :, k) = self%by_rate(:, :, k) + factor*at_dofs(by_rate(:, :, i))
         end do
      end do

   contains

      pure function at_dofs(slopes)
         real(wp), intent(in) :: slopes(:, :)
         real(wp) :: at_dofs(n, n)

         at_dofs = matmul(variation%shape, matmul(slopes, transpose(variation%shape)))
      end function at_dofs
   end subroutine new_hill

   !> Number of exponents with a real part above sigma.
   subroutine count_growing(self, sigma, n_growing, is_whole)
      type(hill_t), intent(in) :: self
      real(wp), intent(in) :: sigma                                   !! [1/s]
      integer, intent(out) :: n_growing
      logical, intent(out) :: is_whole                                !! otherwise the set is too small, or the line too rough
      real(wp) :: angle, at, before, next, step, turn
      integer :: i

      n_growing = 0
      is_whole = .false.
      step = self%omega/first_points
      at = 0.0_wp
      turn = 0.0_wp
      before = angle_at(self, cmplx(sigma, at, wp))
      do i = 1, max_points
         if (work_is_over()) return
         next = min(at + step, self%omega)
         angle = angle_at(self, cmplx(sigma, next, wp))
         if (abs(remainder(angle - before)) > longest_turn .and. step > 1.0e-7_wp*self%omega) then
            step = 0.5_wp*step
            cycle
         end if
         turn = turn + remainder(angle - before)
         before = angle
         at = next
         if (at >= self%omega) exit
         if (step < self%omega/first_points) step = 1.5_wp*step
      end do
      if (at < self%omega) return
      turn = -turn/two_pi
      n_growing = nint(turn)
      is_whole = abs(turn - n_growing) < max_turn_defect .and. n_growing >= 0
   end subroutine count_growing

   !> An angle between minus and plus half a turn.
   elemental real(wp) function remainder(angle)
      real(wp), intent(in) :: angle

      remainder = angle - two_pi*anint(angle/two_pi)
   end function remainder

   !> Angle of f.
   real(wp) function angle_at(self, lambda) result(angle)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: lambda
      complex(wp), allocatable :: a(:, :)
      complex(wp) :: dz, s(-self%order:self%order), z
      integer, allocatable :: pivots(:)
      integer :: column, i, info, k, l, n, p, row

      n = self%n_dofs
      s = [(lambda + cmplx(0.0_wp, k*self%omega, wp), k=-self%order, self%order)]
      allocate (a(n*size(s), n*size(s)), pivots(n*size(s)))
      do l = -self%order, self%order
         column = n*(l + self%order)
         do k = -self%order, self%order
            row = n*(k + self%order)
            a(row + 1:row + n, column + 1:column + n) = self%by_displacement(:, :, k - l) + s(l)*self%by_rate(:, :, k - l)
         end do
         associate (block => a(column + 1:column + n, column + 1:column + n))
            block = block + s(l)**2*self%structure%mass + s(l)*self%structure%damping + self%structure%stiffness
            do p = 1, size(self%structure%parts)
               call self%structure%parts(p)%evaluate_growing(s(l), z, dz)
               do i = 1, n
                  block(:, i) = block(:, i) + z*self%structure%parts(p)%acts*self%structure%parts(p)%feels(i)
               end do
            end do
         end associate
      end do
      angle = -self%degree*sum(atan2(aimag(s), real(s) + self%offset))
      call zgetrf(size(a, 1), size(a, 1), a, size(a, 1), pivots, info)
      do i = 1, size(a, 1)
         angle = angle + atan2(aimag(a(i, i)), real(a(i, i)))
         if (pivots(i) /= i) angle = angle + 0.5_wp*two_pi
      end do
   end function angle_at
end module hb_hill
