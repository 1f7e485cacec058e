!> The course of a curve of motions: whether it returns to a motion that it has passed, and whether its tones lock ahead.
!> The phases of unknown tones are arbitrary and drift along a curve, and a motion of several periods of the loads may be
!> shifted by one of them. Two motions are therefore compared after the shift that brings them closest. A torus ends at a
!> saddle-node of periodic motions where its tones lock: the frequency f of a combination of the tones vanishes there as
!> the square root of the distance, so that f**2 is a linear function of the value of the curve; where the tones are
!> commensurate without locking, f itself is one. Source: Guckenheimer and Holmes, Nonlinear Oscillations, Dynamical
!> Systems, and Bifurcations of Vector Fields (1983), sections 2.1 and 3.4.
module hb_curve_course
   use hb_deflation, only: shifted
   use hb_error_estimate, only: near_commensurate
   use hb_followed_motion, only: followed_motion_t, origin_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_level, only: level_t
   use hb_tones, only: tones_t
   implicit none
   private
   public :: curve_course_t, has_images, image_of, nearest_phases

   integer, parameter :: n_points = 4                                 ! from which the frequency of a combination is extrapolated
   real(wp), parameter :: min_decrease = 1.5_wp                       ! of it over these points
   real(wp), parameter :: max_copies = 64.0_wp                        ! of a motion by shifts
   real(wp), parameter :: straight = 0.15_wp                          ! largest relative change of the slope of a straight line

   !> The points of one branch so far.
   type :: curve_course_t
      type(origin_t), allocatable :: folds(:)                         !! with their sets and grids
      real(wp), allocatable :: lengths(:)                             !! of the arc up to each fold
      real(wp), allocatable :: values(:)                              !! of the last ends of steps
      real(wp), allocatable :: omega(:, :)                            !! [rad/s], (n_tones, the last ends of steps)
   contains
      procedure :: begin => curve_course_begin
      procedure :: add_fold => curve_course_add_fold
      procedure :: add_step => curve_course_add_step
      procedure :: locks => curve_course_locks
   end type curve_course_t

contains

   !> Begins a branch.
   pure subroutine curve_course_begin(self)
      class(curve_course_t), intent(inout) :: self

      self%folds = [origin_t ::]
      self%lengths = [real(wp) ::]
      self%values = [real(wp) ::]
      if (allocated(self%omega)) deallocate (self%omega)
   end subroutine curve_course_begin

   !> Adds a fold.
   subroutine curve_course_add_fold(self, x, level, length)
      class(curve_course_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! its unknowns
      type(level_t), intent(in) :: level                              !! its set and grid
      real(wp), intent(in) :: length                                  !! of the arc up to there
      type(origin_t) :: fold

      fold%x = x
      fold%level = level_t(level%set, level%n_samples)
      self%folds = [self%folds, fold]
      self%lengths = [self%lengths, length]
   end subroutine curve_course_add_fold

   !> Adds the end of a step.
   pure subroutine curve_course_add_step(self, value, omega)
      class(curve_course_t), intent(inout) :: self
      real(wp), intent(in) :: value
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      integer :: first

      if (.not. allocated(self%omega)) allocate (self%omega(size(omega), 0))
      first = max(1, size(self%values) - n_points + 2)
      self%values = [self%values(first:), value]
      self%omega = reshape([self%omega(:, first:), omega], [size(omega), size(self%values)])
   end subroutine curve_course_add_step

   !> Whether the tones lock ahead: the frequency of a combination is small and its square extrapolates to zero.
   subroutine curve_course_locks(self, tones, largest_frequency, is_locking, combination, value)
      class(curve_course_t), intent(in) :: self
      type(tones_t), intent(in) :: tones                              !! of the curve; the frequencies are not used
      real(wp), intent(in) :: largest_frequency                       !! of a combination that nearly vanishes, relative to a tone
      logical, intent(out) :: is_locking
      integer, allocatable, intent(out) :: combination(:)             !! (n_tones)
      real(wp), intent(out) :: value                                  !! at which they do
      type(tones_t) :: here
      real(wp) :: f(n_points), frequency, slopes(n_points - 1)

      is_locking = .false.
      value = 0.0_wp
      if (size(self%values) < n_points) return
      here = tones
      here%omega = self%omega(:, n_points)
      call near_commensurate(here, combination, frequency)
      if (frequency > largest_frequency*maxval(abs(here%omega))) return
      f = matmul(real(combination, wp), self%omega)
      associate (p => self%values, m => n_points)
         if (any(f(2:)*f(:m - 1) <= 0.0_wp) .or. any(abs(f(2:)) >= abs(f(:m - 1)))) return
         if (abs(f(1)) < min_decrease*abs(f(m))) return
         if (any((p(2:) - p(:m - 1))*(p(m) - p(1)) <= 0.0_wp)) return
         slopes = (f(2:)**2 - f(:m - 1)**2)/(p(2:) - p(:m - 1))
         is_locking = maxval(abs(slopes)) <= (1.0_wp + straight)*minval(abs(slopes))
         value = p(m) - f(m)**2/slopes(m - 1)
      end associate
   end subroutine curve_course_locks

   !> The phases by which a motion of a curve has to be shifted to be closest to another one, (n_tones): any of unknown
   !> tones, of given ones those that leave the loads as they are.
   function nearest_phases(self, reference, x) result(phases)
      class(followed_motion_t), intent(in) :: self
      real(wp), intent(in) :: reference(:), x(:)                      !! unknowns of the balance, and others, on the present set
      real(wp) :: phases(self%model%system%tones%n_tones)
      integer :: copies(size(phases)), i, m, rest
      real(wp) :: distance, least, there(size(phases))

      copies = copies_of(self)
      least = huge(1.0_wp)
      associate (n => size(self%weights), set => self%problem%model%discretisation%harmonics, tones => self%free_phases())
         do i = 0, product(copies) - 1
            rest = i
            do m = 1, size(copies)
               there(m) = two_pi*modulo(rest, copies(m))/copies(m)
               rest = rest/copies(m)
            end do
            call add_free_phases(set, tones, self%weights, reference, x, there)
            distance = norm2((shifted(x(:n), set, there) - reference(:n))/self%weights)
            if (.not. distance < least) cycle
            least = distance
            phases = there
         end do
      end associate
   end function nearest_phases

   !> Whether a motion of a curve has images that differ in its phases alone.
   logical function has_images(self)
      class(followed_motion_t), intent(in) :: self

      has_images = .not. allocated(self%known%impacts)                ! otherwise the unknowns are a state
      if (has_images) has_images = size(self%free_phases()) > 0 .or. any(copies_of(self) > 1)
   end function has_images

   !> A motion of a curve, or a direction, with shifted phases.
   function image_of(self, x, phases) result(image)
      class(followed_motion_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: phases(:)                               !! (n_tones)
      real(wp) :: image(size(x))

      associate (n => size(self%weights))
         image(:n) = shifted(x(:n), self%problem%model%discretisation%harmonics, phases)
         image(n + 1:) = x(n + 1:)
      end associate
   end function image_of

   !> Numbers of shifts of given tones, over a period, that leave the loads as they are, (n_tones): more than 1 if all loads are at
   !> multiples of a number, as for motions of several periods of the loads.
   pure function copies_of(self) result(copies)
      class(followed_motion_t), intent(in) :: self
      integer :: copies(self%model%system%tones%n_tones)
      integer :: h, i, m

      associate (discretisation => self%problem%model%discretisation, system => self%model%system)
         copies = 0
         do h = 1, discretisation%harmonics%n_harmonics
            if (discretisation%loads%is_zero_at(h)) cycle
            copies = [(common_divisor(copies(m), discretisation%harmonics%tuples(m, h)), m=1, size(copies))]
         end do
         if (any([(system%laws(i)%law%n_phases > 0 .or. allocated(system%laws(i)%law%modulation), i=1, size(system%laws))])) &
            copies = system%tones%subharmonic                         ! the loads of laws are in tones of the input
         copies = max(1, copies)
         where (system%tones%is_unknown) copies = 1
         if (product(real(copies, wp)) > max_copies) copies = 1
      end associate
   end function copies_of

   pure recursive integer function common_divisor(a, b) result(divisor)
      integer, intent(in) :: a, b

      divisor = abs(a)
      if (b /= 0) divisor = common_divisor(b, modulo(abs(a), abs(b)))
   end function common_divisor

   !> Adds the shifts of the phases of unknown tones that bring a motion closest to a reference, judged by its harmonics of the
   !> first order in one of them.
   pure subroutine add_free_phases(set, tones, weights, reference, x, phases)
      type(harmonics_t), intent(in) :: set                            !! of both
      integer, intent(in) :: tones(:)                                 !! the unknown ones
      real(wp), intent(in) :: weights(:)                              !! typical motion, (unknowns of the balance)
      real(wp), intent(in) :: reference(:), x(:)                      !! unknowns of the balance, and others
      real(wp), intent(inout) :: phases(:)                            !! [rad], (n_tones)
      complex(wp) :: product
      real(wp) :: turned(size(weights))
      integer :: d, h, i

      turned = shifted(x(:size(weights)), set, phases)
      do i = 1, size(tones)
         product = (0.0_wp, 0.0_wp)
         do h = 1, set%n_harmonics
            associate (k => set%tuples(:, h))
               if (abs(k(tones(i))) /= 1 .or. sum(abs(k(tones))) /= 1) cycle
               do d = 0, size(weights)/set%n_coefficients - 1
                  associate (a => d*set%n_coefficients + set%cos_at(h), b => d*set%n_coefficients + set%sin_at(h))
                     product = product + cmplx((turned(a)*reference(a) + turned(b)*reference(b))/weights(a)**2, &
                                               k(tones(i))*(turned(b)*reference(a) - turned(a)*reference(b))/weights(a)**2, wp)
                  end associate
               end do
            end associate
         end do
         if (abs(product) > 0.0_wp) phases(tones(i)) = phases(tones(i)) + atan2(aimag(product), real(product))
      end do
   end subroutine add_free_phases
end module hb_curve_course
