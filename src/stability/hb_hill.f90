!> How many disturbances of a periodic motion grow, of structures with parts whose stiffness depends on the frequency: delays.
!>
!> A disturbance exp(lambda t) times a function of the period has harmonics at s_k = lambda + i k omega, coupled by the slopes of
!> the laws along the motion. Hill's determinant f of their equations, divided by a power of s_k + a for each row, has the
!> period i omega in lambda, no poles where Re(lambda) > -a, and is constant for large Re(lambda). By the principle of the argument
!> its zeros with Re(lambda) > sigma, one for each such disturbance, are the turns of f along one period of the line at sigma.
!> Harmonics beyond those of the slopes are not coupled: what they add are the turns of the determinant g of a single harmonic along
!> the rest of the line, up to frequencies at which the structure has inertia alone. Steps follow the logarithms of f and g, whose
!> real part drops before a weakly damped mode: two equal ones turn the angle once around, which no step would show.
!>
!> Of a sector, disturbances have any nodal diameter p beside that of their harmonic: each p has a determinant f_p. A shift by
!> i omega turns f_p into that of another diameter, so that the turns of all together are whole.
!> Source: G. W. Hill, Acta Mathematica 8 (1886) 1-36; H. Nyquist, Bell System Technical Journal 11 (1932) 126-147.
module hb_hill
   use hb_cancellation, only: work_is_over
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_stability, only: stability_method, stability_t, unknown_because, verdict
   use hb_structure, only: structure_t
   use hb_variation, only: piece_t, variation_t
   implicit none
   private
   public :: assess_by_hill, has_determinant, work_of_hill

   real(wp), parameter :: growth_margins(*) = [2.0e-2_wp, 5.0e-3_wp]  ! of growth rates, relative to the frequency
   real(wp), parameter :: margins_given(*) = [2.0e-2_wp, 2.0e-3_wp, 2.0e-4_wp] ! likewise, of a given frequency: no exponent is zero
   real(wp), parameter :: max_turn_defect = 0.1_wp                    ! distance of the turns from a whole number
   real(wp), parameter :: longest_turn = two_pi/8                     ! change of log f from one point of the line to the next
   real(wp), parameter :: growth_of_step = 1.5_wp
   real(wp), parameter :: last_change = 0.05_wp                       ! of log g in steps of a third of the frequency
   integer, parameter :: n_last = 4                                   ! such steps
   integer, parameter :: first_points = 24, max_points = 20000        ! of a line
   integer, parameter :: extra_harmonics = 8                          ! harmonics beyond those of the motion, at least
   integer, parameter :: samples_of_harmonic = 8
   integer, parameter :: usual_points = 60, points_of_mode = 40

   type :: hill_t
      integer :: n_dofs = 0, order = 0
      real(wp) :: omega = 0.0_wp                                      !! [rad/s]
      real(wp) :: offset = 0.0_wp                                     !! a [1/s]
      integer :: n_diameters = 1                                      !! of disturbances: the number of sectors
      integer :: degree = 0                                           !! of the determinant of a harmonic in s_k
      type(structure_t) :: structure
      integer, allocatable :: at_laws(:), inner(:)                    !! degrees of freedom on which laws act, and the others, which
                                                                      !! are eliminated from each harmonic
      complex(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :)   !! (at_laws, at_laws, -2 order:2 order), harmonics
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
      self%reason = unknown_because%at_limit                          ! unless the counts agree
      do i = 1, size(margin)
         call count_growing(hill, margin(i)*hill%omega, right, is_whole)
         if (.not. is_whole) return
         if (right > 0) then
            self%n_unstable = right
            self%verdict = verdict%unstable
            self%reason = unknown_because%none
            if (i == size(margin)) return
            call count_growing(hill, margin(size(margin))*hill%omega, right, is_whole)   ! those that grow slowly, too
            if (is_whole) self%n_unstable = max(self%n_unstable, right)
            return
         end if
         call count_growing(hill, -margin(i)*hill%omega, above, is_whole)
         if (.not. is_whole) return
         if (above /= n_neutral) cycle
         self%verdict = verdict%stable
         self%reason = unknown_because%none
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
         has = has .and. parts(i)%is_known_growing()
         if (parts(i)%kind == kind_of_part%maxwell) &
            has = has .and. all(2.0_wp*maxval(growth_margins)*omega*parts(i)%times < 1.0_wp)
      end do
   end function has_determinant

   !> Approximate work in nanoseconds.
   pure real(wp) function work_of_hill(variation, structure) result(work)
      type(variation_t), intent(in) :: variation
      type(structure_t), intent(in) :: structure
      real(wp) :: m, n, n_blocks

      n = real(variation%n_dofs, wp)
      n_blocks = real(2*order_of(variation) + 1, wp)
      m = n_blocks*count(is_at_laws(variation, structure))
      work = 4.0_wp*n_diameters_of(structure%parts)*(usual_points*m**2*(m/3.0_wp + 20.0_wp) + &
                                                     (usual_points*n_blocks + points_of_mode*n)*n**2*(n/3.0_wp + 20.0_wp))
   end function work_of_hill

   !> Nodal diameters of disturbances: one without sectors.
   pure integer function n_diameters_of(parts) result(n)
      type(frequency_part_t), intent(in) :: parts(:)

      n = max(1, maxval(parts%n_sectors))
   end function n_diameters_of

   !> Degrees of freedom that are not eliminated: those of laws, and multipliers between two of these.
   pure function is_at_laws(variation, structure)
      type(variation_t), intent(in) :: variation
      type(structure_t), intent(in) :: structure
      logical :: is_at_laws(variation%n_dofs)
      integer :: i

      is_at_laws = any(abs(variation%shape) > 0.0_wp, dim=2)
      do i = 1, size(structure%parts)
         associate (part => structure%parts(i))
            if (part%kind /= kind_of_part%neighbour .or. part%is_of_previous) cycle
            if (is_at_laws(part%copy) .and. any(is_at_laws .and. part%feels > 0.0_wp)) &
               is_at_laws = is_at_laws .or. part%acts > 0.0_wp
         end associate
      end do
   end function is_at_laws

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
      real(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :), by_state(:, :, :), phases(:), shapes(:, :)
      integer :: degrees(variation%n_dofs), i, k, n, n_samples
      logical :: is_retained(variation%n_dofs)

      n = variation%n_dofs
      self%n_dofs = n
      self%order = order_of(variation)
      self%omega = variation%motion%omega(1)
      self%structure = structure
      self%offset = self%omega
      self%n_diameters = n_diameters_of(structure%parts)
      degrees = 0
      do i = 1, n
         if (any(abs(structure%mass(i, :)) > 0.0_wp)) then
            degrees(i) = 2
         else if (any(abs(structure%damping(i, :)) > 0.0_wp)) then
            degrees(i) = 1
         end if
      end do
      do i = 1, size(structure%parts)                                 ! a copy and its original are one degree of freedom
         associate (part => structure%parts(i))
            if (part%kind /= kind_of_part%neighbour .or. part%is_of_previous) cycle
            k = findloc(part%feels > 0.0_wp, .true., dim=1)
            associate (both => degrees([k, part%copy]))
               degrees(k) = maxval(both)
            end associate
            degrees(part%copy) = 0
         end associate
      end do
      self%degree = sum(degrees)
      is_retained = is_at_laws(variation, structure)
      self%at_laws = pack([(i, i=1, n)], is_retained)
      self%inner = pack([(i, i=1, n)], .not. is_retained)
      n_samples = samples_of_harmonic*2*self%order
      allocate (by_displacement(variation%n_coordinates, variation%n_coordinates, n_samples))
      allocate (by_rate, mold=by_displacement)
      allocate (by_state(variation%n_coordinates, variation%n_states, n_samples))
      phases = [(two_pi*i/n_samples, i=0, n_samples - 1)]
      call variation%find_slopes(piece, phases/self%omega, by_displacement, by_rate, by_state)
      allocate (shapes, source=variation%shape(self%at_laws, :))
      associate (m => size(self%at_laws))
         allocate (self%by_displacement(m, m, -2*self%order:2*self%order), self%by_rate(m, m, -2*self%order:2*self%order), &
                   source=(0.0_wp, 0.0_wp))
      end associate
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
         real(wp) :: at_dofs(size(self%at_laws), size(self%at_laws))

         at_dofs = matmul(shapes, matmul(slopes, transpose(shapes)))
      end function at_dofs
   end subroutine new_hill

   !> Number of exponents with a real part above sigma.
   subroutine count_growing(self, sigma, n_growing, is_whole)
      type(hill_t), intent(in) :: self
      real(wp), intent(in) :: sigma                                   !! [1/s]
      integer, intent(out) :: n_growing
      logical, intent(out) :: is_whole                                !! otherwise the set is too small, or the line too rough
      integer :: diameter
      logical :: is_complete
      real(wp) :: sum_of_turns, turn

      n_growing = 0
      is_whole = .false.
      sum_of_turns = 0.0_wp
      do diameter = 0, self%n_diameters - 1
         call count_turns(self, sigma, diameter, turn, is_complete)
         if (.not. is_complete) return
         sum_of_turns = sum_of_turns + turn
      end do
      n_growing = nint(sum_of_turns)
      is_whole = abs(sum_of_turns - n_growing) < max_turn_defect .and. n_growing >= 0
   end subroutine count_growing

   !> Turns of the determinant of disturbances of a nodal diameter: of the coupled harmonics along a period of the line, of all
   !> others along the rest of it. Motions are real: below zero g is the conjugate of that of the opposite diameter, which is
   !> counted with this one.
   subroutine count_turns(self, sigma, diameter, turn, is_complete)
      type(hill_t), intent(in) :: self
      real(wp), intent(in) :: sigma                                   !! [1/s]
      integer, intent(in) :: diameter
      real(wp), intent(out) :: turn
      logical, intent(out) :: is_complete
      real(wp) :: at_end, beyond, of_next

      associate (last => self%order*self%omega)
         call follow(self, cmplx(sigma, 0.0_wp, wp), self%omega, diameter, .true., turn, at_end, is_complete)
         if (is_complete) call follow(self, cmplx(sigma, last, wp), self%omega, diameter, .false., of_next, at_end, is_complete)
         if (is_complete) call follow(self, cmplx(sigma, last + self%omega, wp), huge(1.0_wp), diameter, .false., beyond, at_end, &
                                      is_complete)
      end associate
      if (is_complete) turn = -(turn + of_next + 2.0_wp*beyond - remainder(2.0_wp*at_end))/two_pi
   end subroutine count_turns

   !> Follows the angle of f, or of g, along a line upwards: over a length, or until g is constant.
   subroutine follow(self, from, length, diameter, is_coupled, turn, angle, is_complete)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: from                                 !! [1/s]
      real(wp), intent(in) :: length                                  !! [1/s]
      integer, intent(in) :: diameter
      logical, intent(in) :: is_coupled                               !! f; otherwise g
      real(wp), intent(out) :: turn                                   !! change of the angle
      real(wp), intent(out) :: angle                                  !! at the end
      logical, intent(out) :: is_complete
      complex(wp) :: before, change, there
      real(wp) :: at, next, step
      integer :: i, n_constant

      is_complete = .false.
      step = self%omega/first_points
      at = 0.0_wp
      turn = 0.0_wp
      n_constant = 0
      before = log_at(self, from, diameter, is_coupled)
      angle = aimag(before)
      do i = 1, max_points
         if (work_is_over()) return
         next = min(at + step, length)
         there = log_at(self, from + cmplx(0.0_wp, next, wp), diameter, is_coupled)
         change = cmplx(real(there - before), remainder(aimag(there - before)), wp)
         if (abs(change) > longest_turn .and. step > 1.0e-7_wp*(self%omega + at)) then
            step = 0.5_wp*step
            n_constant = 0
            cycle
         end if
         turn = turn + aimag(change)
         angle = aimag(there)
         n_constant = merge(n_constant + 1, 0, abs(change) < last_change .and. 3.0_wp*(next - at) >= aimag(from) + at)
         before = there
         at = next
         is_complete = at >= length .or. (.not. is_coupled .and. n_constant == n_last)
         if (is_complete) return
         step = growth_of_step*step
         if (is_coupled) step = min(step, self%omega/first_points)
         if (.not. is_coupled) step = min(step, 0.5_wp*(aimag(from) + at))
      end do
   end subroutine follow

   !> An angle between minus and plus half a turn.
   elemental real(wp) function remainder(angle)
      real(wp), intent(in) :: angle

      remainder = angle - two_pi*anint(angle/two_pi)
   end function remainder

   !> Logarithm of f, or of g, of disturbances of a nodal diameter.
   complex(wp) function log_at(self, s, diameter, is_coupled) result(logarithm)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: s                                    !! [1/s]
      integer, intent(in) :: diameter
      logical, intent(in) :: is_coupled

      if (is_coupled) then
         logarithm = log_of_coupled(self, s, diameter)
      else
         logarithm = log_of_single(self, s, diameter)
      end if
   end function log_at

   !> Logarithm of the determinant of the coupled harmonics, divided.
   complex(wp) function log_of_coupled(self, lambda, diameter) result(logarithm)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: lambda
      integer, intent(in) :: diameter
      complex(wp), allocatable :: a(:, :)
      complex(wp) :: s(-self%order:self%order)
      integer :: column, k, l, n, row

      n = size(self%at_laws)
      s = [(lambda + cmplx(0.0_wp, k*self%omega, wp), k=-self%order, self%order)]
      logarithm = -self%degree*sum(log(s + self%offset))
      allocate (a(n*size(s), n*size(s)))
      do l = -self%order, self%order
         column = n*(l + self%order)
         do k = -self%order, self%order
            row = n*(k + self%order)
            a(row + 1:row + n, column + 1:column + n) = self%by_displacement(:, :, k - l) + s(l)*self%by_rate(:, :, k - l)
         end do
         call add_structure(self, s(l), l, diameter, a(column + 1:column + n, column + 1:column + n), logarithm)
      end do
      call add_logarithm(a, logarithm)
   end function log_of_coupled

   !> Logarithm of the determinant of a harmonic of this diameter that is not coupled, divided.
   complex(wp) function log_of_single(self, s, diameter) result(logarithm)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: s
      integer, intent(in) :: diameter
      complex(wp) :: a(size(self%at_laws), size(self%at_laws))

      a = self%by_displacement(:, :, 0) + s*self%by_rate(:, :, 0)
      logarithm = -self%degree*log(s + self%offset)
      call add_structure(self, s, 0, diameter, a, logarithm)
      call add_logarithm(a, logarithm)
   end function log_of_single

   !> Adds the structure at s, without its inner degrees of freedom, to the block of harmonic l, and the logarithm of their
   !> determinant.
   subroutine add_structure(self, s, l, diameter, block, logarithm)
      type(hill_t), intent(in) :: self
      complex(wp), intent(in) :: s
      integer, intent(in) :: l, diameter
      complex(wp), intent(inout) :: block(:, :)                       !! (at_laws, at_laws)
      complex(wp), intent(inout) :: logarithm
      type(frequency_part_t) :: part
      complex(wp), allocatable :: inner(:, :), transfer(:, :), whole(:, :)     ! may be large: not on the stack
      complex(wp) :: dz, z
      integer :: i, info, p, pivots(size(self%inner))

      allocate (whole, source=s**2*self%structure%mass + s*self%structure%damping + self%structure%stiffness)
      do p = 1, size(self%structure%parts)
         part = self%structure%parts(p)
         call part%set_tuple([l], further=diameter)
         call part%evaluate_growing(s, z, dz)
         do i = 1, self%n_dofs
            if (abs(part%feels(i)) > 0.0_wp) whole(:, i) = whole(:, i) + z*part%acts*part%feels(i)
         end do
      end do
      block = block + whole(self%at_laws, self%at_laws)
      if (size(self%inner) == 0) return
      allocate (inner, source=whole(self%inner, self%inner))
      allocate (transfer, source=whole(self%inner, self%at_laws))
      call factorise(inner, pivots, logarithm)
      call zgetrs("N", size(inner, 1), size(transfer, 2), inner, size(inner, 1), pivots, transfer, size(inner, 1), info)
      block = block - matmul(whole(self%at_laws, self%inner), transfer)
   end subroutine add_structure

   !> Adds the logarithm of the determinant of a matrix, which is overwritten.
   subroutine add_logarithm(a, logarithm)
      complex(wp), intent(inout), contiguous :: a(:, :)
      complex(wp), intent(inout) :: logarithm
      integer :: pivots(size(a, 1))

      call factorise(a, pivots, logarithm)
   end subroutine add_logarithm

   !> Factorises a matrix, and adds the logarithm of its determinant.
   subroutine factorise(a, pivots, logarithm)
      complex(wp), intent(inout), contiguous :: a(:, :)
      integer, intent(out) :: pivots(:)
      complex(wp), intent(inout) :: logarithm
      integer :: i, info

      if (size(a) == 0) return
      call zgetrf(size(a, 1), size(a, 1), a, size(a, 1), pivots, info)
      do i = 1, size(a, 1)
         if (abs(a(i, i)) > 0.0_wp) logarithm = logarithm + log(a(i, i))
         if (pivots(i) /= i) logarithm = logarithm + cmplx(0.0_wp, 0.5_wp*two_pi, wp)
      end do
   end subroutine factorise
end module hb_hill
