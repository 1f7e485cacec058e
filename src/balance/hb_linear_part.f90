!> The linear part of the balance: the dynamic stiffness of each harmonic, its factors on demand, and its
!> products with coefficients.
!> If S is singular (a structure that can move freely, an undamped resonance), weak supports restrain it for first
!> guesses and first steps; in a residual they occur only along a homotopy in the laws, and vanish as these grow.
!> Source: docs/why/theory.md, sections 3, 5.6 and 6.3.
module hb_linear_part
   use hb_amplitudes, only: amplitudes_t
   use hb_block_factors, only: block_factors_t, new_block_factors
   use hb_dynamic_stiffness, only: chunk_of_columns, dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_null_space, only: find_null_space
   use hb_structure, only: structure_t
   use hb_threads, only: n_threads
   use hb_thresholds, only: small_share
   implicit none
   private
   public :: linear_part_t, new_linear_part

   type, extends(dynamic_stiffness_t) :: linear_part_t
      logical, allocatable :: is_singular(:)                          !! (n_harmonics) the structure can move freely
      logical :: has_supports = .false.                               !! in any harmonic
      real(wp) :: support_share = 0.0_wp                              !! of the supports in residual and tangent, 0 to 1
      logical, allocatable :: is_free(:)                              !! (n_law) neither the structure nor a law determines the
                                                                      !! mean value of the coordinate
      real(wp), allocatable, private :: support(:)                    ! (n_law) [N/m]
      complex(wp), allocatable, private :: undamped(:, :, :)          ! `condensed` without artificial damping, if there is any
      complex(wp), allocatable, private :: free_motion(:, :)          ! without laws, [m], (n_law, n_harmonics); not allocated
      real(wp), allocatable, private :: scales(:, :)                  ! of `find_scales`, (n_law, 2), while nothing has changed
      type(block_factors_t), private :: factors                       ! LU of S on its supports, of the requested harmonics
   contains
      procedure :: move => linear_part_move
      procedure :: adopt_loads => linear_part_adopt_loads
      procedure :: change_loads => linear_part_change_loads
      procedure :: hold_free => linear_part_hold_free
      procedure :: support_in => linear_part_support_in
      procedure :: add_supports => linear_part_add_supports
      procedure :: damp => linear_part_damp
      procedure :: find_reaction => linear_part_find_reaction
      procedure :: find_contact_residual => linear_part_find_contact_residual
      procedure :: find_contact_slope => linear_part_find_contact_slope
      procedure :: force_beyond_contacts => linear_part_force_beyond_contacts
      procedure :: find_reaction_slope => linear_part_find_reaction_slope
      procedure :: find_motion => linear_part_find_motion
      procedure :: find_scales => linear_part_find_scales
      procedure :: solve => linear_part_solve
      procedure :: compliance => linear_part_compliance
      procedure, private :: factorise => linear_part_factorise
   end type linear_part_t

contains

   !> Creates the linear part of a dynamic stiffness, which is moved into it. Supports are a tenth of the stiffness in
   !> the first harmonic that is not singular.
   subroutine new_linear_part(self, stiffness)
      type(linear_part_t), intent(out) :: self
      type(dynamic_stiffness_t), intent(inout) :: stiffness
      integer :: h, i
      real(wp) :: stiffest

      call stiffness%transfer_to(self)
      allocate (self%is_singular(self%n_harmonics), self%free_motion(self%n_law, self%n_harmonics))
      allocate (self%is_free(self%n_law), source=.false.)
      call self%linear_amplitudes(self%free_motion, self%is_singular)
      self%has_supports = any(self%is_singular)
      h = max(1, findloc(self%is_singular, .false., dim=1))
      self%support = [(small_share*abs(self%entry(i, i, h)), i=1, self%n_law)]
      stiffest = maxval(self%support)
      if (stiffest <= 0.0_wp) stiffest = 1.0_wp
      where (self%support <= epsilon(1.0_wp)*stiffest) self%support = stiffest
      call new_block_factors(self%factors, self%pattern, self%n_harmonics)
   end subroutine new_linear_part

   !> As `move` of the dynamic stiffness; supports are unchanged.
   subroutine linear_part_move(self, frequencies, drives, error)
      class(linear_part_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)
      real(wp), intent(in) :: drives(:)
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%free_motion)) deallocate (self%free_motion)
      if (allocated(self%scales)) deallocate (self%scales)
      call self%factors%forget()
      call self%dynamic_stiffness_t%move(frequencies, drives, error)
   end subroutine linear_part_move

   subroutine linear_part_adopt_loads(self, part, positions)
      class(linear_part_t), intent(inout) :: self
      type(dynamic_stiffness_t), intent(in) :: part
      integer, intent(in) :: positions(:)
      complex(wp) :: c(self%n_law, size(positions))
      logical :: is_singular(size(positions))

      if (allocated(self%scales)) deallocate (self%scales)
      call self%dynamic_stiffness_t%adopt_loads(part, positions)
      call part%linear_amplitudes(c, is_singular)
      self%free_motion(:, positions) = c
   end subroutine linear_part_adopt_loads

   !> Changes the loads of a linear part without slopes: condenses the harmonics whose loads differ, and the fastest one,
   !> because rounding depends on its frequency. The numbers are those of a new linear part. Fails as
   !> `new_dynamic_stiffness` does.
   subroutine linear_part_change_loads(self, structure, frequencies, before, loads, error, n_condensed)
      class(linear_part_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure                      !! of which it was made
      real(wp), intent(in) :: frequencies(:)                          !! likewise
      type(amplitudes_t), intent(in) :: before                        !! likewise
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: n_condensed                   !! harmonics
      type(dynamic_stiffness_t) :: part
      integer, allocatable :: positions(:), tuples(:, :)              ! without tuples, the argument is absent
      integer :: h
      logical :: is_other(size(frequencies))

      if (present(n_condensed)) n_condensed = 0
      if (allocated(self%contacts)) then
         if (allocated(self%free_motion)) deallocate (self%free_motion)
         if (allocated(self%scales)) deallocate (self%scales)
         call self%change_contacts(frequencies, loads, (self%contacts%load_slopes), error)
         return
      end if
      is_other = .false.
      do h = 1, size(frequencies)
         if (any(loads%harmonics == h) .or. any(before%harmonics == h)) is_other(h) = any(loads%of(h) /= before%of(h))
      end do
      if (.not. any(is_other)) return
      is_other(maxloc(abs(frequencies), dim=1)) = .true.
      allocate (positions, source=pack([(h, h=1, size(frequencies))], is_other))
      if (present(n_condensed)) n_condensed = size(positions)
      if (allocated(self%tuples)) tuples = self%tuples(:, positions)
      call new_dynamic_stiffness(part, structure, self%coordinates, frequencies(positions), loads%at(positions), error, &
                                 wanted_slopes_t(of_interior=.false.), tuples)
      if (.not. allocated(error)) call self%adopt_loads(part, positions)
   end subroutine linear_part_change_loads

   !> Factorises S of harmonic h on its supports, unless it is factorised.
   subroutine linear_part_factorise(self, h)
      class(linear_part_t), intent(inout) :: self
      integer, intent(in) :: h
      complex(wp) :: block(self%pattern%n_rows, self%n_law), columns(self%n_law, chunk_of_columns)
      logical :: has_zero_pivot
      integer :: i, k, start

      if (self%factors%are_there(h)) return
      block = (0.0_wp, 0.0_wp)
      do start = 1, self%n_law, chunk_of_columns
         call self%get_columns(start, h, columns(:, :min(chunk_of_columns, self%n_law - start + 1)))
         do k = start, min(start + chunk_of_columns - 1, self%n_law)
            associate (first => self%pattern%first(k), last => self%pattern%last(k), shift => self%pattern%shift(k))
               block(shift + first:shift + last, k) = columns(first:last, k - start + 1)
            end associate
         end do
      end do
      if (self%is_singular(h)) then
         do i = 1, self%n_law
            associate (row => self%pattern%shift(i) + i)
               block(row, i) = block(row, i) + self%support(i)
            end associate
         end do
      end if
      call self%factors%factorise(h, block, has_zero_pivot)
   end subroutine linear_part_factorise

   !> Supports the coordinates whose mean values nothing determines, also in residual and tangent: at most one of each free
   !> motion of the structure along coordinates on which no force depends. If the mean forces are in equilibrium, these supports
   !> are unstressed, and the mean values there are zero; otherwise the coordinates drift.
   subroutine linear_part_hold_free(self, frequencies, is_indifferent)
      class(linear_part_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      logical, intent(in) :: is_indifferent(:)                        !! (n_law) no law depends on the displacement
      real(wp) :: a(self%n_law, count(is_indifferent)), scale(self%n_law)
      real(wp), allocatable :: free_motions(:, :)
      logical :: is_dependent(size(a, 2))
      integer :: columns(size(a, 2))
      integer :: h, i, k

      self%is_free = .false.
      h = findloc(self%is_singular .and. .not. abs(frequencies) > 0.0_wp, .true., dim=1)
      if (h == 0) return
      scale = 1.0_wp                                                  ! as for `is_singular`
      where (self%magnitude(:, h) > 0.0_wp) scale = 1.0_wp/sqrt(self%magnitude(:, h))
      columns = pack([(k, k=1, self%n_law)], is_indifferent)
      a = 0.0_wp
      do k = 1, size(columns)
         do i = self%pattern%first(columns(k)), self%pattern%last(columns(k))
            a(i, k) = scale(i)*real(self%entry(i, columns(k), h), wp)*scale(columns(k))
         end do
      end do
      call find_null_space(a, 100*real(self%n_dofs, wp)*epsilon(1.0_wp), is_dependent, free_motions)
      self%is_free(pack(columns, is_dependent)) = .true.
   end subroutine linear_part_hold_free

   !> Stiffness [N/m] of the support of coordinate i in residual and tangent of harmonic h, zero if there is none.
   pure real(wp) function linear_part_support_in(self, i, h) result(stiffness)
      class(linear_part_t), intent(in) :: self
      integer, intent(in) :: i, h

      stiffness = 0.0_wp
      if (self%is_singular(h)) stiffness = merge(1.0_wp, self%support_share, self%is_free(i))*self%support(i)
   end function linear_part_support_in

   !> Adds the forces of the supports, if there are any.
   subroutine linear_part_add_supports(self, set, u, r)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_law)
      real(wp), intent(inout) :: r(:, :)                              !! [N], as u
      integer :: h, i

      do i = 1, size(u, 2)
         do h = 1, set%n_harmonics
            if (.not. self%is_singular(h)) cycle
            associate (a => set%cos_at(h), b => set%sin_at(h), k => self%support_in(i, h))
               r(a, i) = r(a, i) + k*u(a, i)
               if (b > 0) r(b, i) = r(b, i) + k*u(b, i)
            end associate
         end do
      end do
   end subroutine linear_part_add_supports

   !> Adds artificial structural damping, i times `loss` times the stiffness on which the supports are based,
   !> replacing an earlier one; none with 0.
   subroutine linear_part_damp(self, frequencies, loss)
      class(linear_part_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics); their signs count
      real(wp), intent(in) :: loss                                    !! loss factor, >= 0
      integer :: h, i

      call self%factors%forget()
      if (allocated(self%scales)) deallocate (self%scales)
      if (allocated(self%undamped)) call move_alloc(self%undamped, self%condensed)
      if (allocated(self%shared)) then
         if (allocated(self%shared%extra)) deallocate (self%shared%extra)
      end if
      if (loss <= 0.0_wp) return
      if (allocated(self%shared)) then
         allocate (self%shared%extra(self%n_law, self%n_harmonics), source=(0.0_wp, 0.0_wp))
      else
         self%undamped = self%condensed
      end if
      do h = 1, self%n_harmonics
         if (frequencies(h) == 0.0_wp) cycle
         do i = 1, self%n_law
            associate (more => cmplx(0.0_wp, sign(loss*self%support(i)/small_share, frequencies(h)), wp))
               if (allocated(self%shared)) then
                  self%shared%extra(i, h) = more
               else
                  associate (entry => self%condensed(self%pattern%shift(i) + i, i, h))
                     entry = entry + more
                  end associate
               end if
            end associate
         end do
      end do
   end subroutine linear_part_damp

   !> Computes the reaction s = F_ext - S u, with the loads multiplied by a factor.
   subroutine linear_part_find_reaction(self, set, u, load_factor, reaction)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in), contiguous :: u(:, :)                     !! [m], (n_coefficients, n_law)
      real(wp), intent(in) :: load_factor
      real(wp), intent(inout), contiguous :: reaction(:, :)           !! [N], as u
      integer :: h, n

      if (size(u, 2) == 1) then
         call find_reaction_of_one(set, load_factor, self%load(1, :), self%condensed(1, 1, :), u(:, 1), reaction(:, 1))
         return
      end if
      if (allocated(self%shared)) then
         call find_shared_reaction(self, set, u, load_factor, reaction)
         return
      end if
      n = n_threads(size(self%condensed))
      if (n == 1) then
         do h = 1, set%n_harmonics
            call find_reaction_in(self, set, h, u, load_factor, reaction)
         end do
      else
         !$omp parallel do num_threads(n)
         do h = 1, set%n_harmonics
            call find_reaction_in(self, set, h, u, load_factor, reaction)
         end do
      end if
   end subroutine linear_part_find_reaction

   !> The residual of many contacts of a whole model, k (u - load_factor u_stuck + C (F - c k u)), with the compliance C of stuck
   !> contacts: the equations times k C, whose tangent has its eigenvalues between 0 and k where laws are no stiffer than k.
   subroutine linear_part_find_contact_residual(self, set, u, force, load_factor, is_exact, r)
      class(linear_part_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_law)
      real(wp), intent(in) :: force(:, :)                             !! F of the laws [N], as u
      real(wp), intent(in) :: load_factor
      logical, intent(in) :: is_exact                                 !! otherwise by the modes of the structure alone
      real(wp), intent(out) :: r(:, :)                                !! [N], as u
      complex(wp), dimension(:, :), allocatable :: p, z
      integer :: i

      allocate (p, source=self%force_beyond_contacts(set, u, force))
      allocate (z, mold=p)
      if (is_exact) then
         call self%contacts%respond(p, z)
      else
         call self%contacts%multiply(p, z)
      end if
      r = set%coefficients(load_factor*self%contacts%stuck + z)
      do i = 1, size(r, 2)
         r(:, i) = self%magnitude(i, 1)*(u(:, i) - r(:, i))
      end do
   end subroutine linear_part_find_contact_residual

   !> The derivative of this residual at constant u, where the frequencies change by `rates`, with them the loads, and the forces of
   !> the laws by `force_slope`.
   subroutine linear_part_find_contact_slope(self, set, u, force, rates, force_slope, slope)
      class(linear_part_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_law)
      real(wp), intent(in) :: force(:, :)                             !! F of the laws [N], as u
      real(wp), intent(in) :: rates(:)                                !! (n_harmonics)
      real(wp), intent(in) :: force_slope(:, :)                       !! as F
      real(wp), intent(out) :: slope(:, :)                            !! as u
      complex(wp), allocatable :: beyond(:, :), z(:, :)
      integer :: h, i

      allocate (beyond, source=self%force_beyond_contacts(set, 0.0_wp*u, force_slope))
      do h = 1, self%n_harmonics
         do i = 1, self%n_law
            beyond(i, h) = beyond(i, h) + rates(h)*self%contacts%contact_stiffness_slope(i)*set%amplitude(u(:, i), h)
         end do
      end do
      allocate (z, mold=beyond)
      call self%contacts%find_slope(self%force_beyond_contacts(set, u, force), rates, beyond, z)
      slope = set%coefficients(z)
      do i = 1, size(slope, 2)
         slope(:, i) = -self%magnitude(i, 1)*slope(:, i)
      end do
   end subroutine linear_part_find_contact_slope

   !> c k u - F, what stuck contacts would exert beyond the laws [N], (n_law, n_harmonics).
   pure function linear_part_force_beyond_contacts(self, set, u, force) result(p)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_law)
      real(wp), intent(in) :: force(:, :)                             !! F of the laws [N], as u
      complex(wp), allocatable :: p(:, :)
      integer :: h, i

      allocate (p(self%n_law, self%n_harmonics))
      do h = 1, self%n_harmonics
         do i = 1, self%n_law
            p(i, h) = self%contacts%contact_stiffness(i, h)*set%amplitude(u(:, i), h) - set%amplitude(force(:, i), h)
         end do
      end do
   end function linear_part_force_beyond_contacts

   !> The reaction of a stiffness of shared matrices.
   subroutine find_shared_reaction(self, set, u, load_factor, reaction)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)
      real(wp), intent(in) :: load_factor
      real(wp), intent(inout) :: reaction(:, :)
      complex(wp), allocatable :: c(:, :), s(:, :)
      integer :: h, k

      allocate (c(self%n_law, set%n_harmonics), s(self%n_law, set%n_harmonics))
      do h = 1, set%n_harmonics
         do k = 1, self%n_law
            c(k, h) = set%amplitude(u(:, k), h)
         end do
      end do
      call self%shared%multiply(c, s)
      s = load_factor*self%load - s
      do h = 1, set%n_harmonics
         do k = 1, self%n_law
            call set%set_amplitude(reaction(:, k), h, s(k, h))
         end do
      end do
   end subroutine find_shared_reaction

   !> The reaction in harmonic h alone.
   subroutine find_reaction_in(self, set, h, u, load_factor, reaction)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: h
      real(wp), intent(in), contiguous :: u(:, :)
      real(wp), intent(in) :: load_factor
      real(wp), intent(inout), contiguous :: reaction(:, :)
      complex(wp) :: c, s(size(u, 2))
      integer :: k

      associate (cosine => set%cos_at(h), sine => set%sin_at(h))
         s = load_factor*self%load(:, h)
         do k = 1, size(u, 2)
            c = cmplx(u(cosine, k), 0.0_wp, wp)
            if (sine > 0) c = cmplx(u(cosine, k), -u(sine, k), wp)
            associate (first => self%pattern%first(k), last => self%pattern%last(k), shift => self%pattern%shift(k))
               s(first:last) = s(first:last) - self%condensed(shift + first:shift + last, k, h)*c
            end associate
         end do
         reaction(cosine, :) = real(s)
         if (sine > 0) reaction(sine, :) = -aimag(s)
      end associate
   end subroutine find_reaction_in

   !> The reaction of one degree of freedom, without the loops over blocks, which would take a tenth of the time of a
   !> product.
   pure subroutine find_reaction_of_one(set, load_factor, load, stiffness, u, reaction)
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: load_factor
      complex(wp), intent(in) :: load(:), stiffness(:)                !! (n_harmonics)
      real(wp), intent(in), contiguous :: u(:)                        !! (n_coefficients)
      real(wp), intent(inout), contiguous :: reaction(:)              !! as u
      integer :: h

      do h = 1, set%n_harmonics
         associate (c => set%cos_at(h), s => set%sin_at(h), a => real(stiffness(h)), b => aimag(stiffness(h)))
            if (s > 0) then                                           ! (a + i b) (u_c - i u_s)
               reaction(c) = load_factor*real(load(h)) - (a*u(c) + b*u(s))
               reaction(s) = -load_factor*aimag(load(h)) - (a*u(s) - b*u(c))
            else
               reaction(c) = load_factor*real(load(h)) - a*u(c)
            end if
         end associate
      end do
   end subroutine find_reaction_of_one

   !> Computes the derivative of the reaction if the frequency of each harmonic changes by `turns` and its drive by
   !> `drive_turns`: (dP/dw - dS/dw u) turns + (dP/ddrive - dS/ddrive u) drive_turns. The stiffness must have slopes.
   subroutine linear_part_find_reaction_slope(self, set, u, load_factor, turns, slope, drive_turns)
      class(linear_part_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_law)
      real(wp), intent(in) :: load_factor
      real(wp), intent(in) :: turns(:)                                !! (n_harmonics)
      real(wp), intent(out) :: slope(:, :)                            !! [N s], as u
      real(wp), intent(in), optional :: drive_turns(:)                !! (n_harmonics), default zero
      complex(wp) :: condensed(self%pattern%n_rows, self%n_law), load(self%n_law), s
      integer :: h, i, k

      do h = 1, set%n_harmonics
         condensed = turns(h)*self%condensed_slope(:, :, h)
         load = turns(h)*self%load_slope(:, h)
         if (present(drive_turns)) then
            condensed = condensed + drive_turns(h)*self%condensed_drive_slope(:, :, h)
            load = load + drive_turns(h)*self%load_drive_slope(:, h)
         end if
         do i = 1, size(u, 2)
            s = load_factor*load(i)
            do k = self%pattern%first(i), self%pattern%last(i)
               s = s - condensed(self%pattern%shift(k) + i, k)*set%amplitude(u(:, k), h)
            end do
            call set%set_amplitude(slope(:, i), h, s)
         end do
      end do
   end subroutine linear_part_find_reaction_slope

   !> Computes the motion without laws; for a structure that can move freely that on its supports.
   subroutine linear_part_find_motion(self, set, u)
      class(linear_part_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(out) :: u(:, :)                                !! [m], (n_coefficients, n_law)
      complex(wp) :: c(size(u, 2))
      logical :: is_singular(set%n_harmonics)
      integer :: h, i

      if (.not. allocated(self%free_motion)) then
         allocate (self%free_motion(self%n_law, self%n_harmonics))
         call self%linear_amplitudes(self%free_motion, is_singular)
      else
         is_singular = self%is_singular
      end if
      do h = 1, set%n_harmonics
         c = self%free_motion(:, h)
         if (is_singular(h)) then
            c = self%load(:, h)
            call self%factorise(h)
            call self%factors%solve(h, c)
         end if
         do i = 1, size(u, 2)
            call set%set_amplitude(u(:, i), h, c(i))
         end do
      end do
   end subroutine linear_part_find_motion

   !> Finds the sizes of motion and forces without laws at each coordinate: norms of the motion, and of the larger of load and
   !> force of the structure in each harmonic.
   subroutine linear_part_find_scales(self, set, motion, load)
      class(linear_part_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(out) :: motion(:), load(:)                     !! [m], [N], (n_law)
      real(wp) :: loads(set%n_harmonics), u(set%n_coefficients, self%n_law)
      integer :: h, i

      if (.not. allocated(self%scales)) then
         call self%find_motion(set, u)
         allocate (self%scales(self%n_law, 2))
         self%scales(:, 1) = norm2(u, dim=1)
         do i = 1, self%n_law
            do h = 1, set%n_harmonics
               associate (s => self%entry(i, i, h))
                  loads(h) = max(abs(self%load(i, h)), abs(s*set%amplitude(u(:, i), h)))
               end associate
            end do
            associate (shift => exponent(maxval(loads)))              ! the squares may be out of range although the norm is not
               self%scales(i, 2) = scale(sqrt(sum(scale(loads, -shift)**2)), shift)
            end associate
         end do
      end if
      motion = self%scales(:, 1)
      load = self%scales(:, 2)
   end subroutine linear_part_find_scales

   !> Solves S step = r on the supports.
   subroutine linear_part_solve(self, set, r, step)
      class(linear_part_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in), contiguous :: r(:)                        !! [N], (n_coefficients*n_law)
      real(wp), intent(out), contiguous :: step(:)                    !! [m], as r
      integer :: h

      do h = 1, self%n_harmonics
         call self%factorise(h)
      end do
      call self%factors%solve_harmonics(set, r, step)
   end subroutine linear_part_solve

   !> Compliance |w.S^-1 w| [m/N] in harmonic h along the weights w of some coordinates; without h, in the first
   !> harmonic in which the structure cannot move freely: the static one, unless the set has no zero tuple or the
   !> structure no support.
   function linear_part_compliance(self, coordinates, weights, h) result(compliance)
      class(linear_part_t), intent(inout) :: self
      integer, intent(in) :: coordinates(:)                           !! (n)
      real(wp), intent(in) :: weights(:)                              !! (n)
      integer, intent(in), optional :: h
      real(wp) :: compliance
      complex(wp) :: force(self%n_law), response(self%n_law)
      integer :: harmonic

      harmonic = max(1, findloc(self%is_singular, .false., dim=1))
      if (present(h)) harmonic = h
      force = (0.0_wp, 0.0_wp)
      force(coordinates) = cmplx(weights, kind=wp)
      response = force
      call self%factorise(harmonic)
      call self%factors%solve(harmonic, response)
      compliance = abs(dot_product(force, response))
   end function linear_part_compliance
end module hb_linear_part
