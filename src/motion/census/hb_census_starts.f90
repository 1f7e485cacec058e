!> First guesses of unknown motions: directed ones and random ones, by which a census and a curve search for motions.
!>
!> The size of a guess x_0 + a d is not arbitrary: its balance along the direction d, d.r(x_0 + a d), changes its sign where the
!> forces of inertia, springs and loads do the same work in d. These roots a, of six decades about the typical motion, are the
!> sizes at which a motion in this direction is possible; in one harmonic they are those of the nonlinear normal modes.
!>
!> - *Directed*: static equilibria under the mean loads; then vibrations about each of them in one low harmonic, with shapes that
!>   are eigenvectors of the tangent there, in four phases.
!> - *Random*: about a random equilibrium, in one to three low harmonics, with random shapes and mean values; the size is mostly
!>   such a root, and the phases are mostly such that the loads supply the power that damping takes. Of several coordinates some
!>   starts choose sizes and phases one after the other: in weakly coupled ones nearly all combinations are motions.
!>
!> Random numbers are those of a generator of its own, so that a seed gives the same starts with every compiler: P. L'Ecuyer,
!> Communications of the ACM 31 (1988) 742-774, figure 3.
module hb_census_starts
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: work_is_over
   use hb_deflation, only: shifted
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: int64, two_pi, wp
   use hb_lapack, only: dgeev, dgetrf, dgetrs
   use hb_problem, only: problem_t
   use hb_thresholds, only: negligible_share
   implicit none
   private
   public :: new_starts, start_kind, start_kind_names, starts_t

   type :: start_kind_t
      integer :: given = 1                                            !! the first guess of the model
      integer :: equilibrium = 2
      integer :: mode = 3
      integer :: random = 4
      integer :: mirror = 5                                           !! the mirror image of a known motion
      integer :: deflated = 6                                         !! near a known motion, repelled from all of these
      integer :: continued = 7                                        !! passed by the branch of a known motion (hb_load_branch)
   end type start_kind_t
   type(start_kind_t), parameter :: start_kind = start_kind_t()
   character(*), parameter :: start_kind_names(7) = [character(16) :: "first guess", "equilibrium", "mode", "random start", &
                                                     "mirror image", "deflation", "continuation"]

   integer, parameter :: max_coordinates = 40                         ! for equilibria and shapes, whose tangents are dense
   integer, parameter :: max_dense = 600                              ! unknowns, likewise for shapes
   integer, parameter :: max_equilibria = 12
   integer, parameter :: n_random_means = 20                          ! directions in which equilibria are searched for
   integer, parameter :: max_lowest = 8                               ! harmonics of random starts
   integer, parameter :: max_single = 4                               ! harmonics of modes
   integer, parameter :: max_shapes = 4                               ! of each harmonic
   integer, parameter :: max_roots = 6                                ! sizes of a direction
   integer, parameter :: n_scan = 24                                  ! phases at which the power of a guess is evaluated
   real(wp), parameter :: share_at_roots = 0.8_wp                     ! of random starts; others have any size, or any phase
   real(wp), parameter :: share_apart = 0.4_wp                        ! of those of several coordinates: one after the other
   integer, parameter :: max_apart = 6                                ! coordinates of such a start
   real(wp), parameter :: spread_of_sizes = 0.5_wp, spread_near = 0.1_wp ! of their logarithms
   integer, parameter :: n_phases = 4                                 ! of a mode
   real(wp), parameter :: min_size_ratio = 1.0e-3_wp, max_size_ratio = 1.0e4_wp ! motion of a guess, relative to the typical one
   real(wp), parameter :: size_ratio = 1.5_wp                         ! of consecutive sizes
   integer, parameter :: mean_steps = 40                              ! of Newton's method for an equilibrium

   type :: mode_t
      integer :: equilibrium = 0
      real(wp) :: size_of_motion = 0.0_wp
      real(wp), allocatable :: direction(:)
      integer :: harmonic = 0
   end type mode_t

   type :: starts_t
      integer :: n_directed = 0
      real(wp), allocatable :: equilibria(:, :)                       !! (n_unknowns, any)
      type(harmonics_t), private :: harmonics
      integer, private :: n_dofs = 0
      integer, allocatable, private :: lowest(:)                      ! harmonics with the lowest tuples, except the zero tuple
      type(mode_t), allocatable, private :: modes(:)
      integer, private :: seed = 0
      integer, private :: state(2) = 1                                ! of the random numbers
   contains
      procedure :: directed => starts_directed
      procedure :: draw => starts_draw
      procedure :: draw_near => starts_draw_near
      procedure :: draw_state => starts_draw_state
      procedure, private :: number => starts_number
      procedure, private :: restart => starts_restart
      procedure, private :: normal => starts_normal
   end type starts_t

contains

   !> Prepares the starts of a problem whose first unknowns are coefficients, degree of freedom by degree of freedom; further
   !> ones keep the value that they have in `base`.
   subroutine new_starts(self, problem, harmonics, base, seed)
      type(starts_t), intent(out) :: self
      class(problem_t), intent(inout) :: problem
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in), contiguous :: base(:)                     !! coefficients zero, (n_unknowns)
      integer, intent(in) :: seed                                     !! >= 0

      self%harmonics = harmonics
      self%n_dofs = size(base)/harmonics%n_coefficients
      self%seed = seed
      call self%restart(0)
      self%lowest = lowest_harmonics(harmonics, max_lowest)
      allocate (self%modes(0))
      call find_equilibria(self, problem, base)
      call find_modes(self, problem)
      self%n_directed = size(self%equilibria, 2) + n_phases*size(self%modes)
   end subroutine new_starts

   !> A directed start, by its number from 1.
   subroutine starts_directed(self, number, x, kind)
      class(starts_t), intent(in) :: self
      integer, intent(in) :: number
      real(wp), intent(out) :: x(:)                                   !! (n_unknowns)
      integer, intent(out) :: kind                                    !! one of `start_kind`
      integer :: k

      kind = start_kind%equilibrium
      if (number <= size(self%equilibria, 2)) then
         x = self%equilibria(:, number)
         return
      end if
      kind = start_kind%mode
      k = number - size(self%equilibria, 2) - 1                       ! all modes in one phase, then in the next one
      associate (mode => self%modes(1 + modulo(k, size(self%modes))))
         x = self%equilibria(:, mode%equilibrium) + mode%size_of_motion* &
             turned(self, mode%direction, mode%harmonic, (k/size(self%modes))*two_pi/n_phases)
      end associate
   end subroutine starts_directed

   !> A random start: it depends on the seed and its number alone, whatever was found before.
   subroutine starts_draw(self, problem, number, x)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      integer, intent(in) :: number                                   !! from 1
      real(wp), intent(out), contiguous :: x(:)                       !! (n_unknowns)
      real(wp) :: direction(size(x)), sizes(max_roots), size_of_motion
      integer :: base, c, d, h, i, n, n_roots, s
      logical :: is_in_phase

      call self%restart(number)
      base = 1 + int(self%number()*size(self%equilibria, 2))
      x = self%equilibria(:, base)
      if (self%n_dofs > 1 .and. size(self%lowest) > 0) then
         if (self%number() < share_apart) then
            call draw_apart(self, problem, x)
            return
         end if
      end if
      direction = 0.0_wp
      n = 1 + int(3.0_wp*self%number())
      is_in_phase = self%number() < 0.5_wp
      do i = 1, merge(n, 0, size(self%lowest) > 0)
         h = self%lowest(1 + int(self%number()**2*size(self%lowest))) ! lower ones more often
         do d = 1, self%n_dofs
            c = (d - 1)*self%harmonics%n_coefficients + self%harmonics%cos_at(h)
            s = (d - 1)*self%harmonics%n_coefficients + self%harmonics%sin_at(h)
            direction(c) = direction(c) + self%normal()
            if (.not. is_in_phase) direction(s) = direction(s) + self%normal()
         end do
         if (is_in_phase) direction = turned(self, direction, h, two_pi*self%number())
      end do
      if (self%harmonics%has_zero .and. (self%number() < 0.5_wp .or. size(self%lowest) == 0)) then
         do d = 1, self%n_dofs
            direction((d - 1)*self%harmonics%n_coefficients + 1) = self%normal()
         end do
      end if
      direction = direction*problem%x_scale/max(norm2(direction), tiny(1.0_wp))
      call find_sizes(problem, x, direction, sizes, n_roots)
      size_of_motion = exp(log(10.0_wp)*(2.0_wp*self%number() - 1.0_wp))
      if (n_roots > 0) then
         i = 1 + int(n_roots*self%number())
         if (self%number() < share_at_roots) size_of_motion = exp(spread_of_sizes*self%normal())
         size_of_motion = size_of_motion*sizes(i)
      end if
      x = x + size_of_motion*direction
      if (self%number() < share_at_roots) call turn_to_root(self, problem, x)
   end subroutine starts_draw

   !> A random start of a time integration: amplitudes, cos - i sin, relative to a typical motion.
   subroutine starts_draw_state(self, number, amplitudes)
      class(starts_t), intent(inout) :: self
      integer, intent(in) :: number                                   !! from 1
      complex(wp), intent(out) :: amplitudes(:)                       !! (n_dofs)
      real(wp) :: size_of_motion
      integer :: i

      call self%restart(number)
      size_of_motion = exp(self%normal())
      do i = 1, size(amplitudes)
         amplitudes(i)%re = size_of_motion*self%normal()
         amplitudes(i)%im = size_of_motion*self%normal()
      end do
   end subroutine starts_draw_state

   !> Adds a vibration at each of some coordinates, one after the other: in one low harmonic, with one of the sizes that are
   !> possible there beside those before it, or none, and with a phase of its own.
   subroutine draw_apart(self, problem, x)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(inout), contiguous :: x(:)                     !! an equilibrium, on return a start
      real(wp) :: direction(size(x)), sizes(max_roots)
      integer :: d, h, i, k, n_roots, order(self%n_dofs)

      order = [(d, d=1, self%n_dofs)]
      do i = 1, min(self%n_dofs, max_apart)
         k = i + int(self%number()*(self%n_dofs - i + 1))
         d = order(k)
         order(k) = order(i)
         order(i) = d
         h = self%lowest(1 + int(self%number()**2*size(self%lowest)))
         direction = 0.0_wp
         direction((d - 1)*self%harmonics%n_coefficients + self%harmonics%cos_at(h)) = 1.0_wp
         direction = direction*problem%x_scale
         call find_sizes(problem, x, direction, sizes, n_roots)
         k = int(self%number()*(n_roots + 1))
         if (k == 0) cycle
         x = x + sizes(k)*direction
         call turn_to_root(self, problem, x, d)
      end do
   end subroutine draw_apart

   !> A motion of nearly the same size with other phases; its mean values remain.
   subroutine starts_draw_near(self, problem, motion, x)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: motion(:)
      real(wp), intent(out), contiguous :: x(:)
      real(wp) :: factor
      integer :: i, n

      n = self%n_dofs*self%harmonics%n_coefficients
      factor = exp(spread_near*self%normal())
      x = motion
      x(:n) = factor*motion(:n)
      if (self%harmonics%has_zero) then
         do i = 1, n, self%harmonics%n_coefficients
            x(i) = motion(i)
         end do
      end if
      call turn_to_root(self, problem, x)
   end subroutine starts_draw_near

   !> Shifts the phases of a guess to where the loads supply the power that damping takes: the power of the residual,
   !> (dx/dtau).r(x), as a function of a common shift of all phases changes its sign there. Phases are random if it never does.
   !> If a degree of freedom is given, its phases are shifted alone, and its power is that of its own residual.
   subroutine turn_to_root(self, problem, x, dof)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(inout), contiguous :: x(:)
      integer, intent(in), optional :: dof
      real(wp), dimension(size(x)) :: begun, r, there
      real(wp) :: before, phases(self%harmonics%n_tones), power, roots(n_scan), turn(self%harmonics%n_tones)
      complex(wp) :: rate(self%harmonics%n_harmonics)
      integer :: first, i, last, m, n_roots, shape_of(2)

      first = 1
      last = self%n_dofs*self%harmonics%n_coefficients
      if (present(dof)) then
         first = (dof - 1)*self%harmonics%n_coefficients + 1
         last = dof*self%harmonics%n_coefficients
      end if
      shape_of = [self%harmonics%n_coefficients, (last - first + 1)/self%harmonics%n_coefficients]
      phases = [(two_pi*self%number(), m=1, size(phases))]
      turn = 0.0_wp
      turn(1 + int(self%number()*size(turn))) = 1.0_wp
      begun = x
      begun(first:last) = shifted(x(first:last), self%harmonics, phases)
      rate = cmplx(0.0_wp, matmul(turn, real(self%harmonics%tuples, wp)), wp)
      n_roots = 0
      before = 0.0_wp
      there = begun
      do i = 0, n_scan
         there(first:last) = shifted(begun(first:last), self%harmonics, i*two_pi/n_scan*turn)
         call problem%residual(there, r)
         power = sum(self%harmonics%times(rate, reshape(there(first:last), shape_of))*reshape(r(first:last), shape_of))
         if (.not. ieee_is_finite(power)) exit
         if (before*power < 0.0_wp .and. n_roots < size(roots)) then
            n_roots = n_roots + 1
            roots(n_roots) = (i - abs(power)/(abs(power) + abs(before)))*two_pi/n_scan
         end if
         before = power
      end do
      x = begun
      if (n_roots > 0) x(first:last) = shifted(begun(first:last), self%harmonics, roots(1 + int(self%number()*n_roots))*turn)
   end subroutine turn_to_root

   !> Sizes a > 0 at which the balance along a direction, d.r(x + a d), changes its sign.
   subroutine find_sizes(problem, x, direction, sizes, n)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:), direction(:)          !! (n_unknowns)
      real(wp), intent(out) :: sizes(:)
      integer, intent(out) :: n
      real(wp), dimension(size(x)) :: r, there
      real(wp) :: a, before, work

      n = 0
      sizes = 0.0_wp
      a = min_size_ratio
      before = 0.0_wp
      do while (a <= max_size_ratio .and. n < size(sizes))
         there = x + a*direction
         call problem%residual(there, r)
         work = dot_product(direction, r)
         if (.not. ieee_is_finite(work)) return
         if (before*work < 0.0_wp) then
            n = n + 1
            sizes(n) = a*(1.0_wp + (1.0_wp/size_ratio - 1.0_wp)*abs(work)/(abs(work) + abs(before)))
         end if
         before = work
         a = size_ratio*a
      end do
   end subroutine find_sizes

   !> Finds static equilibria: from sizes along each coordinate and random directions, by Newton's method in the mean values. The
   !> first is the one next to rest; rest itself if none is found.
   subroutine find_equilibria(self, problem, base)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: base(:)
      real(wp), dimension(size(base)) :: direction, x
      real(wp) :: sizes(max_roots)
      integer :: at(self%n_dofs), d, i, k, n
      logical :: is_found

      self%equilibria = reshape(base, [size(base), 1])
      if (.not. self%harmonics%has_zero .or. self%n_dofs > max_coordinates) return
      at = [((d - 1)*self%harmonics%n_coefficients + 1, d=1, self%n_dofs)]
      self%equilibria = reshape([real(wp) ::], [size(base), 0])
      x = base
      call settle(problem, at, x, is_found)
      if (is_found) call add(x)
      do i = 1, 2*self%n_dofs + n_random_means
         direction = 0.0_wp
         if (i <= 2*self%n_dofs) then
            direction(at((i + 1)/2)) = merge(1.0_wp, -1.0_wp, modulo(i, 2) == 1)
         else
            direction(at) = [(self%normal(), d=1, self%n_dofs)]
            direction = direction/norm2(direction)
         end if
         direction = direction*problem%x_scale
         call find_sizes(problem, base, direction, sizes, n)
         do k = 1, n
            x = base + sizes(k)*direction
            call settle(problem, at, x, is_found)
            if (is_found) call add(x)
            if (size(self%equilibria, 2) >= max_equilibria .or. work_is_over()) return
         end do
      end do
      if (size(self%equilibria, 2) == 0) call add(base)

   contains

      subroutine add(found)
         real(wp), intent(in) :: found(:)
         integer :: j

         do j = 1, size(self%equilibria, 2)
            if (norm2(found(at) - self%equilibria(at, j)) <= negligible_share*max(norm2(found(at)), norm2(self%equilibria(at, &
                  j)))) return
         end do
         self%equilibria = reshape([self%equilibria, found], [size(found), size(self%equilibria, 2) + 1])
      end subroutine add
   end subroutine find_equilibria

   !> Newton's method in the mean values alone, with a tangent from differences.
   subroutine settle(problem, at, x, is_found)
      class(problem_t), intent(inout) :: problem
      integer, intent(in) :: at(:)                                    !! positions of the mean values
      real(wp), intent(inout), contiguous :: x(:)
      logical, intent(out) :: is_found
      real(wp), parameter :: max_residual = 1.0e-9_wp, step_ratio = 1.0e-7_wp ! relative; of differences
      real(wp), dimension(size(x)) :: r, there, trial
      real(wp) :: before, jacobian(size(at), size(at)), step(size(at), 1), now
      integer :: i, info, k, pivots(size(at))

      is_found = .false.
      call problem%residual(x, r)
      before = norm2(r(at)/problem%r_scale(at))
      do i = 1, mean_steps
         if (.not. ieee_is_finite(before)) return
         is_found = before <= max_residual
         if (is_found) return
         do k = 1, size(at)
            there = x
            there(at(k)) = x(at(k)) + step_ratio*max(problem%x_scale(at(k)), abs(x(at(k))))
            call problem%residual(there, trial)
            jacobian(:, k) = (trial(at) - r(at))/(there(at(k)) - x(at(k)))
         end do
         if (.not. all(ieee_is_finite(jacobian))) return
         call dgetrf(size(at), size(at), jacobian, size(at), pivots, info)
         if (info /= 0) return
         step(:, 1) = -r(at)
         call dgetrs("N", size(at), 1, jacobian, size(at), pivots, step, size(at), info)
         if (info /= 0 .or. .not. all(ieee_is_finite(step))) return
         do k = 0, 10
            trial = x
            trial(at) = x(at) + step(:, 1)/2.0_wp**k
            call problem%residual(trial, there)
            now = norm2(there(at)/problem%r_scale(at))
            if (now < before) exit
         end do
         if (.not. now < before) then
            is_found = before <= 1.0e3_wp*max_residual                 ! rounding
            return
         end if
         x = trial
         r = there
         before = now
      end do
   end subroutine settle

   !> Finds vibrations about each equilibrium in one harmonic.
   subroutine find_modes(self, problem)
      class(starts_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), allocatable :: shapes(:, :), tangent(:, :)
      real(wp) :: direction(size(self%equilibria, 1)), sizes(max_roots)
      integer :: d, e, h, i, k, n

      associate (set => self%harmonics)
         do e = 1, size(self%equilibria, 2)
            if (self%n_dofs <= max_coordinates .and. problem%n_unknowns <= max_dense) then
               if (.not. allocated(tangent)) allocate (tangent(problem%n_unknowns, problem%n_unknowns))
               call problem%tangent(self%equilibria(:, e), tangent)
            end if
            do h = 1, min(size(self%lowest), max_single)
               call find_shapes(self, tangent, self%lowest(h), shapes)
               do i = 1, size(shapes, 2)
                  direction = 0.0_wp
                  do d = 1, self%n_dofs
                     direction((d - 1)*set%n_coefficients + set%cos_at(self%lowest(h))) = shapes(d, i)
                  end do
                  direction = direction*maxval(problem%x_scale(:self%n_dofs*set%n_coefficients))
                  call find_sizes(problem, self%equilibria(:, e), direction, sizes, n)
                  do k = 1, n
                     call add_mode(self%modes, mode_t(e, sizes(k), direction, self%lowest(h)))
                  end do
                  if (work_is_over()) return
               end do
            end do
         end do
      end associate
   end subroutine find_modes

   subroutine add_mode(list, mode)
      type(mode_t), allocatable, intent(inout) :: list(:)
      type(mode_t), intent(in) :: mode

      list = [list, mode]
   end subroutine add_mode

   !> Shapes of a harmonic: eigenvectors of its cosines in the tangent, those of the smallest eigenvalues; without a tangent one
   !> with all coordinates alike.
   subroutine find_shapes(self, tangent, h, shapes)
      class(starts_t), intent(in) :: self
      real(wp), allocatable, intent(in) :: tangent(:, :)              !! not allocated: too large
      integer, intent(in) :: h
      real(wp), allocatable, intent(out) :: shapes(:, :)              !! (n_dofs, any), of length 1
      real(wp) :: block(self%n_dofs, self%n_dofs), left(1, 1), vectors(self%n_dofs, self%n_dofs), work(8*self%n_dofs)
      real(wp), dimension(self%n_dofs) :: imaginary, values
      integer :: at(self%n_dofs), d, i, info
      logical :: is_used(self%n_dofs)

      if (.not. allocated(tangent)) then
         allocate (shapes(self%n_dofs, 1), source=1.0_wp/sqrt(real(self%n_dofs, wp)))
         return
      end if
      at = [((d - 1)*self%harmonics%n_coefficients + self%harmonics%cos_at(h), d=1, self%n_dofs)]
      block = tangent(at, at)
      allocate (shapes(self%n_dofs, 0))
      if (.not. all(ieee_is_finite(block))) return
      call dgeev("N", "V", self%n_dofs, block, self%n_dofs, values, imaginary, left, 1, vectors, self%n_dofs, work, size(work), &
                 info)
      if (info /= 0) return
      is_used = .false.
      do i = 1, min(self%n_dofs, max_shapes)
         d = minloc(abs(values), dim=1, mask=.not. is_used)
         is_used(d) = .true.
         if (abs(imaginary(d)) > 0.0_wp) cycle
         shapes = reshape([shapes, vectors(:, d)/norm2(vectors(:, d))], [self%n_dofs, size(shapes, 2) + 1])
      end do
   end subroutine find_shapes

   !> The motion with other phases of one harmonic.
   pure function turned(self, x, h, angle) result(y)
      class(starts_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      integer, intent(in) :: h
      real(wp), intent(in) :: angle                                   !! [rad]
      real(wp) :: y(size(x))
      integer :: c, d, s

      y = x
      do d = 1, self%n_dofs
         c = (d - 1)*self%harmonics%n_coefficients + self%harmonics%cos_at(h)
         s = (d - 1)*self%harmonics%n_coefficients + self%harmonics%sin_at(h)
         y(c) = cos(angle)*x(c) - sin(angle)*x(s)
         y(s) = sin(angle)*x(c) + cos(angle)*x(s)
      end do
   end function turned

   !> Numbers of the harmonics with the lowest tuples, except the zero tuple.
   pure function lowest_harmonics(harmonics, n) result(lowest)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n                                        !! at most
      integer, allocatable :: lowest(:)
      integer :: h, order

      allocate (lowest(0))
      do order = 1, sum(harmonics%highest)
         do h = 1, harmonics%n_harmonics
            if (size(lowest) >= n) return
            if (sum(abs(harmonics%tuples(:, h))) == order) lowest = [lowest, h]
         end do
      end do
   end function lowest_harmonics

   !> Begins the random numbers of a start.
   subroutine starts_restart(self, number)
      class(starts_t), intent(inout) :: self
      integer, intent(in) :: number                                   !! >= 0
      real(wp) :: ignored
      integer :: i

      associate (s => int(self%seed, int64), n => int(number, int64))
         self%state(1) = 1 + int(modulo(1000003_int64*s + 7919_int64*n, 2147483562_int64))
         self%state(2) = 1 + int(modulo(69621_int64*s + 1000033_int64*n + 12345_int64, 2147483398_int64))
      end associate
      do i = 1, 20                                                    ! neighbouring states begin with similar numbers
         ignored = self%number()
      end do
   end subroutine starts_restart

   !> A random number between 0 and 1, both excluded.
   real(wp) function starts_number(self) result(number)
      class(starts_t), intent(inout) :: self
      integer, parameter :: generator_moduli(2) = [2147483563, 2147483399]
      integer :: z

      self%state(1) = 40014*modulo(self%state(1), 53668) - 12211*(self%state(1)/53668)
      if (self%state(1) < 0) self%state(1) = self%state(1) + generator_moduli(1)
      self%state(2) = 40692*modulo(self%state(2), 52774) - 3791*(self%state(2)/52774)
      if (self%state(2) < 0) self%state(2) = self%state(2) + generator_moduli(2)
      z = self%state(1) - self%state(2)
      if (z < 1) z = z + generator_moduli(1) - 1
      number = real(z, wp)/real(generator_moduli(1), wp)
   end function starts_number

   !> A normally distributed random number, by the transformation of Box and Muller.
   real(wp) function starts_normal(self) result(number)
      class(starts_t), intent(inout) :: self

      number = sqrt(-2.0_wp*log(self%number()))
      number = number*cos(two_pi*self%number())
   end function starts_normal
end module hb_census_starts
