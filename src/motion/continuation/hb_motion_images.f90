!> Images of a motion, which differ in their phases alone. The phases of unknown tones are arbitrary and drift along a curve, and a
!> motion of several periods of the loads may be shifted by one of them. Two motions are therefore compared after the shift that
!> brings them closest.
module hb_motion_images
   use hb_common_divisor, only: common_divisor
   use hb_deflation, only: shifted
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_system, only: system_t
   implicit none
   private
   public :: copies_of, image_of, nearest_phases

   real(wp), parameter :: max_copies = 64.0_wp                        ! of a motion by shifts

contains

   !> The phases by which a motion has to be shifted to be closest to another one, (n_tones): any of unknown
   !> tones, of given ones those that leave the loads as they are.
   pure function nearest_phases(set, copies, tones, weights, reference, x) result(phases)
      type(harmonics_t), intent(in) :: set                            !! of both
      integer, intent(in) :: copies(:)                                !! `copies_of`
      integer, intent(in) :: tones(:)                                 !! with free phases
      real(wp), intent(in) :: weights(:)                              !! typical motion, (unknowns of the balance)
      real(wp), intent(in) :: reference(:), x(:)                      !! unknowns of the balance
      real(wp) :: phases(size(copies))
      integer :: i, m, rest
      real(wp) :: distance, least, there(size(phases))

      least = huge(1.0_wp)
      do i = 0, product(copies) - 1
         rest = i
         do m = 1, size(copies)
            there(m) = two_pi*modulo(rest, copies(m))/copies(m)
            rest = rest/copies(m)
         end do
         call add_free_phases(set, tones, weights, reference, x, there)
         distance = norm2((shifted(x, set, there) - reference)/weights)
         if (.not. distance < least) cycle
         least = distance
         phases = there
      end do
   end function nearest_phases

   !> A motion of a curve, or a direction, with shifted phases.
   pure function image_of(set, n, x, phases) result(image)
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: n                                        !! unknowns of the balance
      real(wp), intent(in) :: x(:)                                    !! these, and others
      real(wp), intent(in) :: phases(:)                               !! (n_tones)
      real(wp) :: image(size(x))

      image(:n) = shifted(x(:n), set, phases)
      image(n + 1:) = x(n + 1:)
   end function image_of

   !> Numbers of shifts of given tones, over a period, that leave the loads as they are, (n_tones): more than 1 if all loads are at
   !> multiples of a number, as for motions of several periods of the loads.
   pure function copies_of(system) result(copies)
      type(system_t), intent(in) :: system
      integer :: copies(system%tones%n_tones)
      integer :: i, m

      associate (tuples => system%load_spectrum%nonzero_tuples())
         copies = [(common_divisor([0, tuples(m, :)]), m=1, size(copies))]
      end associate
      if (any([(system%laws(i)%law%n_phases > 0 .or. allocated(system%laws(i)%law%modulation), i=1, size(system%laws))])) &
         copies = system%tones%subharmonic                         ! the loads of laws are in tones of the input
      copies = max(1, copies)
      where (system%tones%is_unknown) copies = 1
      if (product(real(copies, wp)) > max_copies) copies = 1
   end function copies_of

   !> Adds the shifts of the phases of unknown tones that bring a motion closest to a reference, judged by its harmonics of the
   !> first order in one of them.
   pure subroutine add_free_phases(set, tones, weights, reference, x, phases)
      type(harmonics_t), intent(in) :: set                            !! of both
      integer, intent(in) :: tones(:)                                 !! the unknown ones
      real(wp), intent(in) :: weights(:)                              !! typical motion, (unknowns of the balance)
      real(wp), intent(in) :: reference(:), x(:)                      !! likewise
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
end module hb_motion_images
