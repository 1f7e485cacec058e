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
!> The stiffness of a closed contact is c k, with the damping of the structure: it is part of S here and subtracted from the
!> laws. Source: docs/why/theory.md, section 4; D. J. Rixen, J. Comput. Appl. Math. 168 (2004) 383 (residual flexibility).
module hb_contact_response
   use hb_amplitudes, only: amplitudes_t
   use hb_contact_flexibility, only: contact_flexibility_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm
   implicit none
   private
   public :: contact_response_t, new_contact_response

   real(wp), parameter :: accuracy = 1.0e-13_wp              !! of a motion: below any tolerance
   integer, parameter :: max_terms = 40                      !! of the sum; converging by .11 or better

   type :: contact_response_t
      type(contact_flexibility_t), pointer :: flexibility => null()   !! of the caller, which keeps it
      real(wp), allocatable :: frequencies(:)                !! [rad/s], (n_harmonics)
      complex(wp), allocatable :: stuck(:, :)                !! motion of the coordinates under the loads, contacts stuck [m], (n,
                                                             !! n_harmonics)
      type(amplitudes_t) :: loads                            !! [N], of all degrees of freedom
   contains
      procedure :: multiply => contact_response_multiply
      procedure :: respond => contact_response_respond
      procedure :: contact_stiffness => contact_response_contact_stiffness
      procedure :: recover => contact_response_recover
      procedure :: restricted_to => contact_response_restricted_to
      procedure :: work => contact_response_work
      procedure, private :: find_motion => contact_response_find_motion
   end type contact_response_t

contains

   !> Creates the responses at some frequencies, up to which the modes suffice.
   subroutine new_contact_response(self, flexibility, frequencies, loads)
      type(contact_response_t), intent(out) :: self
      type(contact_flexibility_t), intent(in), target :: flexibility
      real(wp), intent(in) :: frequencies(:)                 !! [rad/s]
      type(amplitudes_t), intent(in) :: loads                !! [N], of all degrees of freedom
      complex(wp), allocatable :: nothing(:, :), x(:, :)

      self%flexibility => flexibility
      self%frequencies = frequencies
      self%loads = loads
      allocate (nothing(flexibility%n, size(frequencies)), source=(0.0_wp, 0.0_wp))
      allocate (x(flexibility%n_dofs, size(frequencies)))
      call self%recover(nothing, x)
      self%stuck = at_contacts(flexibility, x)
   end subroutine new_contact_response

   !> Motion of the coordinates in response to forces there, without loads, by the modes and the first term of the sum.
   subroutine contact_response_multiply(self, force, z)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      complex(wp), intent(out) :: z(:, :)                    !! [m], as force
      real(wp), allocatable :: along(:, :), e(:, :), e_at_contacts(:, :), f(:, :)

      associate (flexibility => self%flexibility)
         allocate (f, source=columns_of(force))
         allocate (along(size(flexibility%squares), size(f, 2)), e(flexibility%n_dofs, size(f, 2)))
         allocate (e_at_contacts, mold=f)
         call project(flexibility%at_contacts, f, along)
         call spread_forces(flexibility, f, e)
         call flexibility%factor%solve(e)
         call flexibility%functionals%times(e, e_at_contacts)
         call remove_modes(flexibility%at_contacts, flexibility%squares, along, e_at_contacts)
         call combine(self, flexibility%at_contacts, along, e_at_contacts, z)
      end associate
   end subroutine contact_response_multiply

   !> The same to rounding.
   subroutine contact_response_respond(self, force, z)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      complex(wp), intent(out) :: z(:, :)                    !! [m], as force
      complex(wp), allocatable :: x(:, :)

      allocate (x(self%flexibility%n_dofs, size(force, 2)))
      call self%find_motion(force, .false., x)
      z = at_contacts(self%flexibility, x)
   end subroutine contact_response_respond

   !> Stiffness of a closed contact in harmonic h [N/m].
   pure complex(wp) function contact_response_contact_stiffness(self, i, h) result(stiffness)
      class(contact_response_t), intent(in) :: self
      integer, intent(in) :: i, h

      stiffness = self%flexibility%contact(i)*factor_at(self, h)
   end function contact_response_contact_stiffness

   !> Motion of all degrees of freedom under the loads and forces at the contacts.
   subroutine contact_response_recover(self, force, x)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! in addition to those of stuck contacts [N], (n, n_harmonics)
      complex(wp), intent(out) :: x(:, :)                    !! [m], (n_dofs, n_harmonics)

      call self%find_motion(force, .true., x)
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

   !> Solves S x = f for forces at contacts and, if wanted, the loads: adds terms of the sum until they are below `accuracy`.
   subroutine contact_response_find_motion(self, force, with_loads, x)
      class(contact_response_t), intent(in) :: self
      complex(wp), intent(in) :: force(:, :)                 !! [N], (n, n_harmonics)
      logical, intent(in) :: with_loads
      complex(wp), intent(out) :: x(:, :)                    !! [m], (n_dofs, n_harmonics)
      real(wp), allocatable :: along(:, :), e(:, :)
      integer, allocatable :: active(:)                      ! harmonics whose terms are not yet small
      complex(wp) :: c, ratio
      logical :: is_small(size(x, 2))
      real(wp) :: largest
      integer :: h, j

      associate (flexibility => self%flexibility)
         allocate (e(flexibility%n_dofs, 2*size(x, 2)))
         call spread_forces(flexibility, columns_of(force), e)
         if (with_loads) call add_loads(self%loads, e)
         allocate (along(size(flexibility%squares), size(e, 2)))
         call project(flexibility%shapes, e, along)
         call flexibility%factor%solve(e)
         call remove_modes(flexibility%shapes, flexibility%squares, along, e)
         call combine(self, flexibility%shapes, along, e, x)
         largest = maxval([(norm2(abs(x(:, h))), h=1, size(x, 2))])
         active = [(h, h=1, size(x, 2))]
         is_small = .not. abs(self%frequencies) > 0.0_wp
         do j = 1, max_terms
            call retain(.not. is_small(active), e)
            active = pack(active, .not. is_small(active))
            if (size(active) == 0) exit
            call find_next(flexibility, e)
            do h = 1, size(active)
               c = factor_at(self, active(h))
               ratio = (square_at(self, active(h))/c)**j/c
               x(:, active(h)) = x(:, active(h)) + ratio*cmplx(e(:, 2*h - 1), e(:, 2*h), wp)
               is_small(active(h)) = abs(ratio)*norm2(e(:, 2*h - 1:2*h)) <= accuracy*largest
            end do
         end do
      end associate
   end subroutine contact_response_find_motion

   !> Leaves out the two columns of some harmonics.
   subroutine retain(is_retained, e)
      logical, intent(in) :: is_retained(:)
      real(wp), intent(inout), allocatable :: e(:, :)
      real(wp), allocatable :: fewer(:, :)
      integer :: h, n

      if (all(is_retained)) return
      allocate (fewer(size(e, 1), 2*count(is_retained)))
      n = 0
      do h = 1, size(is_retained)
         if (.not. is_retained(h)) cycle
         fewer(:, n + 1:n + 2) = e(:, 2*h - 1:2*h)
         n = n + 2
      end do
      call move_alloc(fewer, e)
   end subroutine retain

   !> E = Q K_k^-1 M E.
   subroutine find_next(flexibility, e)
      type(contact_flexibility_t), intent(in) :: flexibility
      real(wp), intent(inout), allocatable :: e(:, :)
      real(wp), allocatable :: along(:, :), forces(:, :)

      allocate (forces, mold=e)
      call flexibility%mass%times(e, forces)
      allocate (along(size(flexibility%squares), size(e, 2)))
      call project(flexibility%shapes, forces, along)
      call flexibility%factor%solve(forces)
      call remove_modes(flexibility%shapes, flexibility%squares, along, forces)
      call move_alloc(forces, e)
   end subroutine find_next

   !> Real and imaginary parts of amplitudes as columns, harmonic by harmonic.
   pure function columns_of(amplitudes) result(columns)
      complex(wp), intent(in) :: amplitudes(:, :)            !! (any, n_harmonics)
      real(wp), allocatable :: columns(:, :)
      integer :: h

      allocate (columns(size(amplitudes, 1), 2*size(amplitudes, 2)))
      do h = 1, size(amplitudes, 2)
         columns(:, 2*h - 1) = real(amplitudes(:, h))
         columns(:, 2*h) = aimag(amplitudes(:, h))
      end do
   end function columns_of

   !> B^T f.
   pure subroutine spread_forces(flexibility, f, forces)
      type(contact_flexibility_t), intent(in) :: flexibility
      real(wp), intent(in) :: f(:, :)                        !! (n, any)
      real(wp), intent(out) :: forces(:, :)                  !! (n_dofs, any)
      integer :: e, i, k

      forces = 0.0_wp
      associate (b => flexibility%functionals)
         do k = 1, size(f, 2)
            do i = 1, b%n_rows
               do e = b%first(i), b%first(i + 1) - 1
                  forces(b%column(e), k) = forces(b%column(e), k) + b%value(e)*f(i, k)
               end do
            end do
         end do
      end associate
   end subroutine spread_forces

   pure subroutine add_loads(loads, forces)
      type(amplitudes_t), intent(in) :: loads
      real(wp), intent(inout) :: forces(:, :)                !! as `columns_of`
      integer :: k

      do k = 1, size(loads%harmonics)
         associate (h => loads%harmonics(k))
            forces(:, 2*h - 1) = forces(:, 2*h - 1) + real(loads%values(:, k))
            forces(:, 2*h) = forces(:, 2*h) + aimag(loads%values(:, k))
         end associate
      end do
   end subroutine add_loads

   !> Components phi^T f.
   subroutine project(shapes, f, along)
      real(wp), intent(in), contiguous :: shapes(:, :)       !! (n, n_modes)
      real(wp), intent(in), contiguous :: f(:, :)            !! (n, any)
      real(wp), intent(out), contiguous :: along(:, :)       !! (n_modes, any)

      associate (n => size(shapes, 1), m => size(shapes, 2))
         call dgemm("T", "N", m, size(f, 2), n, 1.0_wp, shapes, max(1, n), f, max(1, n), 0.0_wp, along, max(1, m))
      end associate
   end subroutine project

   !> Removes the static response of the modes.
   subroutine remove_modes(shapes, squares, along, e)
      real(wp), intent(in), contiguous :: shapes(:, :)
      real(wp), intent(in) :: squares(:)
      real(wp), intent(in) :: along(:, :)                    !! phi^T f
      real(wp), intent(inout), contiguous :: e(:, :)
      real(wp) :: static(size(squares), size(along, 2))

      static = along/spread(squares, 2, size(along, 2))
      associate (n => size(shapes, 1), m => size(shapes, 2))
         call dgemm("N", "N", n, size(e, 2), m, -1.0_wp, shapes, max(1, n), static, max(1, m), 1.0_wp, e, max(1, n))
      end associate
   end subroutine remove_modes

   !> Motion from the modes and the first term of the sum.
   subroutine combine(self, shapes, along, e, x)
      type(contact_response_t), intent(in) :: self
      real(wp), intent(in), contiguous :: shapes(:, :)
      real(wp), intent(in) :: along(:, :)                    !! phi^T f, as `columns_of`
      real(wp), intent(in) :: e(:, :)                        !! likewise
      complex(wp), intent(out) :: x(:, :)
      real(wp) :: weights(size(along, 1), size(along, 2))
      real(wp), allocatable :: of_modes(:, :)
      complex(wp) :: factor, weight
      integer :: h, i

      do h = 1, size(x, 2)
         do i = 1, size(along, 1)
            weight = cmplx(along(i, 2*h - 1), along(i, 2*h), wp)
            weight = weight/(factor_at(self, h)*self%flexibility%squares(i) - square_at(self, h))
            weights(i, 2*h - 1:2*h) = [real(weight), aimag(weight)]
         end do
      end do
      allocate (of_modes, mold=e)
      associate (n => size(shapes, 1), m => size(shapes, 2))
         call dgemm("N", "N", n, size(e, 2), m, 1.0_wp, shapes, max(1, n), weights, max(1, m), 0.0_wp, of_modes, max(1, n))
      end associate
      do h = 1, size(x, 2)
         factor = factor_at(self, h)
         x(:, h) = cmplx(of_modes(:, 2*h - 1), of_modes(:, 2*h), wp) + cmplx(e(:, 2*h - 1), e(:, 2*h), wp)/factor
      end do
   end subroutine combine

   !> Motion of the contact coordinates in a motion of all degrees of freedom.
   function at_contacts(flexibility, x) result(z)
      type(contact_flexibility_t), intent(in) :: flexibility
      complex(wp), intent(in) :: x(:, :)                     !! [m], (n_dofs, any)
      complex(wp), allocatable :: z(:, :)

      z = flexibility%coordinates%amplitudes_of(x)
   end function at_contacts
end module hb_contact_response
