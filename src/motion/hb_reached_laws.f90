!> The laws that a motion reaches: rigid walls that exert no force on it have no influence on its stability. Laws with slopes need
!> no such choice: the slopes are zero.
module hb_reached_laws
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t, law_t
   use hb_law_reach, only: exerts_no_force, has_reach
   use hb_stability, only: harmonic_motion_t
   implicit none
   private
   public :: reached_laws

   integer, parameter :: samples_of_harmonic = 16                     ! of the highest one of a tone: a peak between them is higher
                                                                      ! by 2 %, which is within the margin
   integer, parameter :: max_samples = 100000                         ! of the torus; beyond, all laws are retained
   integer, parameter :: per_part = 4096                              ! samples at one time

contains

   !> The laws without the rigid walls that exert no force on a motion, nor on one that is larger or smaller by a margin.
   function reached_laws(laws, motion, margin) result(reached)
      type(law_box_t), intent(in) :: laws(:)                          !! on its degrees of freedom
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: margin                                  !! relative to the motion
      type(law_box_t), allocatable :: reached(:)
      logical :: is_reached(size(laws))
      integer :: i

      is_reached = [(reaches(laws(i)%law, motion, margin), i=1, size(laws))]
      reached = laws(pack([(i, i=1, size(laws))], is_reached))
   end function reached_laws

   !> Whether a motion reaches a law; laws with slopes count as reached.
   logical function reaches(given, motion, margin)
      class(law_t), intent(in) :: given
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: margin
      class(law_t), allocatable :: law
      complex(wp), allocatable :: amplitudes(:, :)
      real(wp), allocatable :: z(:, :), rates(:, :)
      integer :: counts(size(motion%tuples, 1)), first, last, n

      reaches = .true.
      if (.not. (given%is_multiplier .and. has_reach(given)) .or. given%needs_velocity .or. allocated(given%positions)) return
      counts = samples_of_harmonic*max(1, maxval(abs(motion%tuples), dim=2))
      if (product(real(counts, wp)) > max_samples) return
      n = product(counts)
      allocate (law, source=given)
      call law%prepare(1.0_wp)                                        ! the sign of a force does not depend on it
      amplitudes = matmul(transpose(cmplx(law%shape, 0.0_wp, wp)), motion%amplitudes(law%dofs, :))
      allocate (rates(min(n, per_part), 0))
      do first = 1, n, per_part
         last = min(n, first + per_part - 1)
         z = motion_at(motion%tuples, amplitudes, counts, first, last)
         if (.not. exerts_no_force(law, z, rates(:size(z, 1), :), [1.0_wp/(1.0_wp + margin), 1.0_wp, 1.0_wp + margin])) return
      end do
      reaches = .false.
   end function reaches

   !> Coordinates at some of the points of a grid over the torus, counted along the first tone first, (points, coordinates).
   pure function motion_at(tuples, amplitudes, counts, first, last) result(z)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_coordinates, n_harmonics)
      integer, intent(in) :: counts(:)                                !! points along each tone
      integer, intent(in) :: first, last
      real(wp) :: z(last - first + 1, size(amplitudes, 1))
      real(wp) :: phases(size(counts))
      integer :: i, k, rest

      do i = first, last
         rest = i - 1
         do k = 1, size(counts)
            phases(k) = two_pi*modulo(rest, counts(k))/counts(k)
            rest = rest/counts(k)
         end do
         associate (angles => matmul(phases, real(tuples, wp)))
            z(i - first + 1, :) = real(matmul(amplitudes, cmplx(cos(angles), sin(angles), wp)))
         end associate
      end do
   end function motion_at
end module hb_reached_laws
