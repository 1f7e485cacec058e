!> Whether a branch of a curve returns to motions that it has passed. The phases of unknown tones are arbitrary and drift along a
!> curve, and a motion of several periods of the loads may be shifted by one of them. Two motions are therefore compared after
!> the shift that brings them closest.
module hb_curve_return
   use hb_common_divisor, only: common_divisor
   use hb_deflation, only: shifted
   use hb_discretisation, only: discretisation_t
   use hb_followed_motion, only: followed_motion_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_level, only: level_of, level_t, transferred
   use hb_motion_result, only: curve_position_t
   use hb_point_kinds, only: curve_kind
   use hb_thresholds, only: clearly, faint
   implicit none
   private
   public :: has_images, image_of, nearest_phases, note_course, restore_course

   real(wp), parameter :: max_copies = 64.0_wp                        ! of a motion by shifts

contains

   !> Notes a fold or the end of a step of a branch whose motions have images: the branch may have come back to one of its folds, or
   !> its tones may lock ahead.
   subroutine note_course(self, kind, x, length)
      class(followed_motion_t), intent(inout), target :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: length                                  !! of the arc up to there
      integer :: i
      logical :: is_possible

      if (.not. has_images(self)) return
      select case (kind)
      case (curve_kind%fold)
         do i = 1, size(self%course%folds)
            if (is_at_fold(self, i, x, length)) self%course%is_retraced = .true.
         end do
         call self%course%add_fold(x, self%level, length)
      case (curve_kind%regular)
         call self%problem%move_to_point(x, is_possible)
         if (.not. is_possible) return
         if (size(self%free_phases()) == 0) return
         associate (tones => self%model%system%tones)
            call self%course%add_step(x(size(x)), self%problem%omega(:tones%n_tones))
            call self%course%find_locking(tones, self%model%options%error_estimate%commensurability)
         end associate
      end select
   end subroutine note_course

   !> Whether a fold is the i-th one that the branch has passed, apart from its phases, although the branch has been elsewhere in
   !> between.
   logical function is_at_fold(self, i, x, length)
      class(followed_motion_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: length                                  !! of the arc up to there
      real(wp) :: near, there(size(x))

      near = faint
      associate (accuracy => self%model%options%accuracy, passed => self%course%folds(i))
         if (accuracy%is_on) near = max(near, accuracy%tolerance)
         is_at_fold = length - passed%length > clearly*near
         if (.not. is_at_fold) return
         there = transferred(passed%level%set, self%level%set, passed%x, size(self%problem%which))
         there = image_of(self, there, nearest_phases(self, x, there))
         is_at_fold = norm2((there - x)/self%units_at(x)) <= near
      end associate
   end function is_at_fold

   !> Stores the course of a branch up to its last stored point.
   subroutine restore_course(self, stored, discretisation)
      class(followed_motion_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)                 !! points of this branch, with those before it of other sign
      type(discretisation_t), intent(in) :: discretisation            !! of the model
      type(level_t) :: level
      real(wp), allocatable :: x(:)
      integer :: i

      if (.not. has_images(self)) return
      do i = 1, size(stored)
         if (stored(i)%length*stored(size(stored))%length < 0.0_wp) cycle
         level = level_of(discretisation, stored(i))
         x = transferred(level%set, self%level%set, stored(i)%unknowns, size(self%problem%which))
         call note_course(self, stored(i)%kind, x, abs(stored(i)%length))
      end do
   end subroutine restore_course

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

      has_images = .not. allocated(self%at_point%impacts)             ! otherwise the unknowns are a state
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
            copies = [(common_divisor([copies(m), discretisation%harmonics%tuples(m, h)]), m=1, size(copies))]
         end do
         if (any([(system%laws(i)%law%n_phases > 0 .or. allocated(system%laws(i)%law%modulation), i=1, size(system%laws))])) &
            copies = system%tones%subharmonic                         ! the loads of laws are in tones of the input
         copies = max(1, copies)
         where (system%tones%is_unknown) copies = 1
         if (product(real(copies, wp)) > max_copies) copies = 1
      end associate
   end function copies_of

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
end module hb_curve_return
