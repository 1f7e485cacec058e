!> Responses of a whole finite element model with all contacts closed and stuck to forces at its contacts, at the frequencies
!> of a set: the compliance of the contact coordinates as an operator, without any full matrix.
!>
!> With the matrices of hb_contact_flexibility, c = 1 + i w b and s = w**2 - i w a, the equations S x = f of a harmonic, S = c
!> K_k - s M, have the solution
!>
!>     x = phi (phi^T f)/(c lambda - s) + (1/c) sum_j (s/c)**j e_j,    e_0 = Q K_k^-1 f,   e_(j+1) = Q K_k^-1 M e_j,
!>
!> where Q removes the modes. The sum converges by |s/(c lambda)| of the first mode that is not there. Its first term alone is
!> residual flexibility with modal correction; products with the tangent end there, so that modes cost accuracy of the products
!> of an iteration and never of what it converges to. Real and imaginary parts of all harmonics are right sides of one
!> solution.
!>
!> Along a curve the frequencies and the other forces change: S x' = f' - S' x with S' = c' K_k - s' M, where K_k x follows from
!> S x = f.
!>
!> The stiffness of a closed contact is c k, with the damping of the structure: it is part of S here and subtracted from the
!> laws. Source: docs/why/theory.md, section 4; D. J. Rixen, J. Comput. Appl. Math. 168 (2004) 383 (residual flexibility).
module hb_contact_response
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_contact_flexibility, only: contact_flexibility_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm
   implicit none
   private
   public :: contact_response_t, new_contact_response

   real(wp), parameter :: series_tolerance = 1.0e-13_wp      !! of a motion: below any tolerance
   integer, parameter :: max_terms = 80                      !! of the sum, which converges by .44 or better

   type :: contact_response_t
      type(contact_flexibility_t), pointer :: flexibility => null()   !! of the caller, which keeps it
      real(wp), allocatable :: frequencies(:)                !! [rad/s], (n_harmonics)
      complex(wp), allocatable :: stuck(:, :)                !! motion of the coordinates under the loads, contacts stuck [m], (n,
                                                             !! n_harmonics)
      type(amplitudes_t) :: loads                            !! [N], of all degrees of freedom
      type(amplitudes_t) :: load_slopes                      !! by the frequency of the harmonic [N s], likewise
      complex(wp), allocatable, private :: force(:, :), motion(:, :)  ! of the last `respond`
      complex(wp), allocatable, private :: force_of_all(:, :), all_dofs(:, :) ! of the last `recover`
   contains
      procedure :: multiply => contact_response_multiply
      procedure :: respond => contact_response_respond
      procedure :: contact_stiffness => contact_response_contact_stiffness
      procedure :: contact_stiffness_slope => contact_response_contact_stiffness_slope
      procedure :: recover => contact_response_recover
      procedure :: find_slope => contact_response_find_slope
      procedure :: restricted_to => contact_response_restricted_to
      procedure :: response_to => contact_response_response_to
      procedure :: work => contact_response_work
      procedure, private :: find_motion => contact_response_find_motion
   end type contact_response_t

contains

   !> Creates the responses at some frequencies, up to which the modes suffice.
   subroutine new_contact_response(self, flexibility, frequencies, loads, load_slopes)
      type(contact_response_t), intent(out) :: self
      type(contact_flexibility_t), intent(in), target :: flexibility
      real(wp), intent(in) :: frequencies(:)                 !! [rad/s]
      type(amplitudes_t), intent(in) :: loads                !! [N], of all degrees of freedom
      type(amplitudes_t), intent(in), optional :: load_slopes !! by the frequencies [N s]; default zero

      self%flexibility => flexibility
      self%frequencies = frequencies
      self%loads = loads
      call new_amplitudes(self%load_slopes, flexibility%n_dofs, size(frequencies))
      if (present(load_slopes)) self%load_slopes = load_slopes
      call self%response_to(loads, self%stuck)
   end subroutine new_contact_response

   !> Motion of the coordinates under some forces, contacts stuck.
   subroutine contact_response_response_to(self, loads, z)
      class(contact_response_t), intent(in) :: self
      type(amplitudes_t), intent(in) :: loads                !! [N], of all degrees of freedom
      complex(wp), intent(out), allocatable :: z(:, :)       !! [m], (n, n_harmonics)
      type(contact_response_t) :: loaded
      real(wp), allocatable :: e(:, :)
      complex(wp), allocatable :: part(:, :)

      associate (n => self%flexibility%n, harmonics => loads%harmonics)
         allocate (z(n, size(self%frequencies)), source=(0.0_wp, 0.0_wp))
         if (size(harmonics) == 0) return
         loaded%flexibility => self%flexibility
         loaded%frequencies = self%frequencies(harmonics)
         allocate (e, source=rows_of(loads%values))
         allocate (part(n, size(harmonics)))
         call find_response(loaded, e, part)
         z(:, harmonics) = part
      end associate
   end subroutine contact_response_response_to

   !> Motion of the coordinates in response to forces there, without loads, by the modes and the first term of the sum.
   subroutine contact_response_multiply(self, force, z)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      complex(wp), intent(out) :: z(:, :)                    !! [m], as force
      real(wp), allocatable :: along(:, :), e(:, :), e_at_contacts(:, :), f(:, :)

      associate (flexibility => self%flexibility)
         allocate (f, source=rows_of(force))
         allocate (along(size(f, 1), size(flexibility%squares)))
         call project(flexibility%at_contacts, f, along)
         allocate (e, source=flexibility%coordinates%spread_forces(f))
         call flexibility%factor%solve_at(e)
         allocate (e_at_contacts, source=flexibility%coordinates%values_of(e))
         call remove_modes(flexibility%at_contacts, flexibility%squares, along, e_at_contacts)
         call combine(self, flexibility%at_contacts, along, e_at_contacts, z)
      end associate
   end subroutine contact_response_multiply

   !> The same to rounding. Of a force that is near that of the last call the difference is computed.
   subroutine contact_response_respond(self, force, z)
      class(contact_response_t), intent(inout) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      complex(wp), intent(out) :: z(:, :)                    !! [m], as force

      if (allocated(self%force)) then
         call self%find_motion(force - self%force, .false., z, maxval(norm2(abs(self%motion), 1)))
         z = self%motion + z
      else
         call self%find_motion(force, .false., z)
      end if
      self%force = force
      self%motion = z
   end subroutine contact_response_respond

   !> Stiffness of a closed contact in harmonic h [N/m].
   pure complex(wp) function contact_response_contact_stiffness(self, i, h) result(stiffness)
      class(contact_response_t), intent(in) :: self
      integer, intent(in) :: i, h

      stiffness = self%flexibility%contact(i)*factor_at(self, h)
   end function contact_response_contact_stiffness

   !> Its derivative by the frequency of the harmonic [N s/m].
   pure complex(wp) function contact_response_contact_stiffness_slope(self, i) result(slope)
      class(contact_response_t), intent(in) :: self
      integer, intent(in) :: i

      slope = cmplx(0.0_wp, self%flexibility%contact(i)*self%flexibility%by_stiffness, wp)
   end function contact_response_contact_stiffness_slope

   !> Derivative of the motion of the coordinates where the frequencies change by `rates`, with them the loads, and the forces at
   !> the contacts by `force_slope`.
   subroutine contact_response_find_slope(self, force, rates, force_slope, z)
      class(contact_response_t), intent(inout) :: self
      complex(wp), intent(in) :: force(:, :)                 !! as for `recover` [N], (n, n_harmonics)
      real(wp), intent(in) :: rates(:)                       !! (n_harmonics)
      complex(wp), intent(in) :: force_slope(:, :)           !! as force
      complex(wp), intent(out) :: z(:, :)                    !! as force
      complex(wp), allocatable :: motion(:, :)
      complex(wp) :: ratio, square_slope
      real(wp), allocatable :: e(:, :), f(:, :), inertia(:, :)
      integer :: h

      associate (flexibility => self%flexibility, at => self%flexibility%coordinates)
         allocate (e(2*size(force, 2), flexibility%n_dofs), source=0.0_wp)
         e(:, at%dofs) = at%spread_forces(rows_of(force_slope))
         call add_loads(self%load_slopes, e, rates)
         if (any(abs(rates) > 0.0_wp)) then
            allocate (motion(flexibility%n_dofs, size(rates)))
            call self%recover(force, motion)
            allocate (inertia, mold=e)
            call flexibility%mass%times(rows_of(motion), inertia)
            allocate (f, mold=e)
            f = 0.0_wp
            f(:, at%dofs) = at%spread_forces(rows_of(force))
            call add_loads(self%loads, f)
            do h = 1, size(rates)
               ratio = cmplx(0.0_wp, rates(h)*flexibility%by_stiffness, wp)/factor_at(self, h)
               square_slope = rates(h)*cmplx(2.0_wp*self%frequencies(h), -flexibility%by_mass, wp)
               call add_product(-ratio, f(2*h - 1:2*h, :), e(2*h - 1:2*h, :))
               call add_product(square_slope - ratio*square_at(self, h), inertia(2*h - 1:2*h, :), e(2*h - 1:2*h, :))
            end do
         end if
      end associate
      call find_response(self, e, z)
   end subroutine contact_response_find_slope

   !> Adds a number times a row of complex numbers, given by real and imaginary parts.
   pure subroutine add_product(factor, row, total)
      complex(wp), intent(in) :: factor
      real(wp), intent(in) :: row(:, :)                      !! (2, any)
      real(wp), intent(inout) :: total(:, :)                 !! likewise

      total(1, :) = total(1, :) + real(factor)*row(1, :) - aimag(factor)*row(2, :)
      total(2, :) = total(2, :) + aimag(factor)*row(1, :) + real(factor)*row(2, :)
   end subroutine add_product

   !> Motion of all degrees of freedom under the loads and forces at the contacts.
   subroutine contact_response_recover(self, force, x)
      class(contact_response_t), intent(inout) :: self
      complex(wp), intent(in) :: force(:, :)                 !! in addition to those of stuck contacts [N], (n, n_harmonics)
      complex(wp), intent(out) :: x(:, :)                    !! [m], (n_dofs, n_harmonics)
      complex(wp), allocatable :: z(:, :)
      logical :: is_known

      is_known = allocated(self%all_dofs)
      if (is_known) is_known = all(abs(force - self%force_of_all) <= 0.0_wp)
      if (.not. is_known) then
         allocate (z, mold=force)
         call self%find_motion(force, .true., z, x=x)
         self%force_of_all = force
         self%all_dofs = x
      end if
      x = self%all_dofs
   end subroutine contact_response_recover

   !> The responses of some of the harmonics.
   function contact_response_restricted_to(self, retained) result(part)
      class(contact_response_t), intent(in) :: self
      integer, intent(in) :: retained(:)                     !! numbers of the harmonics
      type(contact_response_t) :: part

      part%flexibility => self%flexibility
      allocate (part%frequencies(size(retained)), source=self%frequencies(retained))
      allocate (part%stuck(size(self%stuck, 1), size(retained)), source=self%stuck(:, retained))
      part%loads = self%loads%at(retained)
      part%load_slopes = self%load_slopes%at(retained)
   end function contact_response_restricted_to

   !> Work of a product, see hb_solver_types%unit_of_work: measured, about 20 Gflop/s.
   pure real(wp) function contact_response_work(self) result(work)
      class(contact_response_t), intent(in) :: self
      real(wp), parameter :: per_entry = 0.3_wp

      work = per_entry*2*size(self%frequencies)*self%flexibility%n_in_factor
   end function contact_response_work

   !> c = 1 + i w b.
   pure complex(wp) function factor_at(self, h) result(factor)
      type(contact_response_t), intent(in) :: self
      integer, intent(in) :: h

      factor = cmplx(1.0_wp, self%frequencies(h)*self%flexibility%by_stiffness, wp)
   end function factor_at

   !> s = w**2 - i w a.
   pure complex(wp) function square_at(self, h) result(square)
      type(contact_response_t), intent(in) :: self
      integer, intent(in) :: h

      square = cmplx(self%frequencies(h)**2, -self%frequencies(h)*self%flexibility%by_mass, wp)
   end function square_at

   !> Solves S x = f for forces at contacts and, if wanted, the loads.
   subroutine contact_response_find_motion(self, force, with_loads, z, size_of_motion, x)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      logical, intent(in) :: with_loads
      complex(wp), intent(out) :: z(:, :)                    !! [m], as force
      real(wp), intent(in), optional :: size_of_motion       !! [m]
      complex(wp), intent(out), optional :: x(:, :)          !! [m], (n_dofs, n_harmonics)
      real(wp), allocatable :: e(:, :)

      associate (flexibility => self%flexibility, at => self%flexibility%coordinates)
         allocate (e(2*size(z, 2), flexibility%n_dofs), source=0.0_wp)
         e(:, at%dofs) = at%spread_forces(rows_of(force))
      end associate
      if (with_loads) call add_loads(self%loads, e)
      call find_response(self, e, z, size_of_motion, x)
   end subroutine contact_response_find_motion

   !> Solves S x = f: adds terms of the sum until they are below `series_tolerance` of the motion at the contacts, or of
   !> `size_of_motion` if this is larger. Harmonics of which they are not are NaN at the contacts.
   subroutine find_response(self, e, z, size_of_motion, x)
      class(contact_response_t), intent(in) :: self
      real(wp), intent(inout), allocatable :: e(:, :)        !! f [N] as `rows_of`, (2 n_harmonics, n_dofs); overwritten
      complex(wp), intent(out) :: z(:, :)                    !! [m], (n, n_harmonics)
      real(wp), intent(in), optional :: size_of_motion       !! [m]
      complex(wp), intent(out), optional :: x(:, :)          !! [m], (n_dofs, n_harmonics)
      real(wp), allocatable :: along(:, :), e_at_contacts(:, :)
      integer, allocatable :: active(:)                      ! harmonics whose terms are not yet small
      complex(wp) :: c, ratio
      logical :: is_small(size(z, 2))
      real(wp) :: largest
      integer :: h, j

      associate (flexibility => self%flexibility, at => self%flexibility%coordinates)
         allocate (along(size(e, 1), size(flexibility%squares)))
         call project(flexibility%shapes, e, along)
         call flexibility%factor%solve(e)
         call remove_modes(flexibility%shapes, flexibility%squares, along, e)
         allocate (e_at_contacts, source=at%values_of(e(:, at%dofs)))
         call combine(self, flexibility%at_contacts, along, e_at_contacts, z)
         if (present(x)) call combine(self, flexibility%shapes, along, e, x)
         largest = maxval(norm2(abs(z), 1))
         if (present(size_of_motion)) largest = max(largest, size_of_motion)
         active = [(h, h=1, size(z, 2))]
         is_small = .not. abs(self%frequencies) > 0.0_wp
         do j = 1, max_terms
            call retain(.not. is_small(active), e)
            active = pack(active, .not. is_small(active))
            if (size(active) == 0) exit
            call find_next(flexibility, e)
            e_at_contacts = at%values_of(e(:, at%dofs))
            do h = 1, size(active)
               c = factor_at(self, active(h))
               ratio = (square_at(self, active(h))/c)**j/c
               z(:, active(h)) = z(:, active(h)) + ratio*cmplx(e_at_contacts(2*h - 1, :), e_at_contacts(2*h, :), wp)
               if (present(x)) x(:, active(h)) = x(:, active(h)) + ratio*cmplx(e(2*h - 1, :), e(2*h, :), wp)
               is_small(active(h)) = abs(ratio)*norm2(e_at_contacts(2*h - 1:2*h, :)) <= series_tolerance*largest
            end do
         end do
         z(:, pack(active, .not. is_small(active))) = ieee_value(1.0_wp, ieee_quiet_nan)    ! no motion rather than a wrong one
      end associate
   end subroutine find_response

   !> Leaves out the two rows of some harmonics.
   subroutine retain(is_retained, e)
      logical, intent(in) :: is_retained(:)
      real(wp), intent(inout), allocatable :: e(:, :)
      integer :: h

      if (.not. all(is_retained)) e = e(pack([(h, h=1, size(e, 1))], [(is_retained((h + 1)/2), h=1, size(e, 1))]), :)
   end subroutine retain

   !> E = E M K_k^-1 Q^T.
   subroutine find_next(flexibility, e)
      type(contact_flexibility_t), intent(in) :: flexibility
      real(wp), intent(inout), allocatable :: e(:, :)
      real(wp), allocatable :: along(:, :), forces(:, :)

      allocate (forces, mold=e)
      call flexibility%mass%times(e, forces)
      allocate (along(size(e, 1), size(flexibility%squares)))
      call project(flexibility%shapes, forces, along)
      call flexibility%factor%solve(forces)
      call remove_modes(flexibility%shapes, flexibility%squares, along, forces)
      call move_alloc(forces, e)
   end subroutine find_next

   !> Real and imaginary parts of amplitudes as rows, harmonic by harmonic.
   pure function rows_of(amplitudes) result(rows)
      complex(wp), intent(in) :: amplitudes(:, :)            !! (any, n_harmonics)
      real(wp) :: rows(2*size(amplitudes, 2), size(amplitudes, 1))
      integer :: h

      do h = 1, size(amplitudes, 2)
         rows(2*h - 1, :) = real(amplitudes(:, h))
         rows(2*h, :) = aimag(amplitudes(:, h))
      end do
   end function rows_of

   pure subroutine add_loads(loads, forces, factors)
      type(amplitudes_t), intent(in) :: loads
      real(wp), intent(inout) :: forces(:, :)                !! as `rows_of`
      real(wp), intent(in), optional :: factors(:)           !! (n_harmonics), default 1
      real(wp) :: factor
      integer :: k

      do k = 1, size(loads%harmonics)
         associate (h => loads%harmonics(k))
            factor = 1.0_wp
            if (present(factors)) factor = factors(h)
            forces(2*h - 1, :) = forces(2*h - 1, :) + factor*real(loads%values(:, k))
            forces(2*h, :) = forces(2*h, :) + factor*aimag(loads%values(:, k))
         end associate
      end do
   end subroutine add_loads

   !> Components f phi.
   subroutine project(shapes, f, along)
      real(wp), intent(in), contiguous :: shapes(:, :)       !! (n, n_modes)
      real(wp), intent(in), contiguous :: f(:, :)            !! (any, n)
      real(wp), intent(out), contiguous :: along(:, :)       !! (any, n_modes)

      associate (k => size(f, 1), n => size(shapes, 1), m => size(shapes, 2))
         call dgemm("N", "N", k, m, n, 1.0_wp, f, max(1, k), shapes, max(1, n), 0.0_wp, along, max(1, k))
      end associate
   end subroutine project

   !> Adds a sum of modes, E = E + along phi^T.
   subroutine add_modes(shapes, along, e)
      real(wp), intent(in), contiguous :: shapes(:, :)       !! (n, n_modes)
      real(wp), intent(in), contiguous :: along(:, :)        !! (any, n_modes)
      real(wp), intent(inout), contiguous :: e(:, :)         !! (any, n)

      associate (k => size(e, 1), n => size(shapes, 1), m => size(shapes, 2))
         call dgemm("N", "T", k, n, m, 1.0_wp, along, max(1, k), shapes, max(1, n), 1.0_wp, e, max(1, k))
      end associate
   end subroutine add_modes

   !> Removes the static response of the modes.
   subroutine remove_modes(shapes, squares, along, e)
      real(wp), intent(in), contiguous :: shapes(:, :)
      real(wp), intent(in) :: squares(:)
      real(wp), intent(in) :: along(:, :)                    !! f phi
      real(wp), intent(inout), contiguous :: e(:, :)

      call add_modes(shapes, -along/spread(squares, 1, size(along, 1)), e)
   end subroutine remove_modes

   !> Motion from the modes and the first term of the sum.
   subroutine combine(self, shapes, along, e, x)
      type(contact_response_t), intent(in) :: self
      real(wp), intent(in), contiguous :: shapes(:, :)
      real(wp), intent(in) :: along(:, :)                    !! f phi, as `rows_of`
      real(wp), intent(in) :: e(:, :)                        !! likewise
      complex(wp), intent(out) :: x(:, :)
      real(wp) :: weights(size(along, 1), size(along, 2))
      real(wp), allocatable :: total(:, :)
      complex(wp) :: weight
      integer :: h, i

      allocate (total, mold=e)
      do h = 1, size(x, 2)
         do i = 1, size(along, 2)
            weight = cmplx(along(2*h - 1, i), along(2*h, i), wp)
            weight = weight/(factor_at(self, h)*self%flexibility%squares(i) - square_at(self, h))
            weights(2*h - 1:2*h, i) = [real(weight), aimag(weight)]
         end do
         associate (inverse => 1.0_wp/factor_at(self, h))
            total(2*h - 1, :) = real(inverse)*e(2*h - 1, :) - aimag(inverse)*e(2*h, :)
            total(2*h, :) = aimag(inverse)*e(2*h - 1, :) + real(inverse)*e(2*h, :)
         end associate
      end do
      call add_modes(shapes, weights, total)
      do h = 1, size(x, 2)
         x(:, h) = cmplx(total(2*h - 1, :), total(2*h, :), wp)
      end do
   end subroutine combine
end module hb_contact_response
