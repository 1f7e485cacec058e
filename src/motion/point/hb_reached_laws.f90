!> The laws that a motion reaches: stops and walls that exert no force on it have no influence on its stability. Without any law its
!> disturbances are those of the structure, whose eigenvalues take a fraction of the time of an integration.
module hb_reached_laws
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t, law_t
   use hb_law_reach, only: exerts_no_force, has_reach
   use hb_stability, only: harmonic_motion_t
   implicit none
   private
   public :: max_gap_to_motion, reached_laws

   real(wp), parameter :: max_gap_to_motion = 0.05_wp                 !! of a motion: a law that is so near may be reached
   integer, parameter :: samples_of_harmonic = 16                     ! of the highest one of a tone: a peak between them is higher
                                                                      ! by 2 %, which is within the margin
   real(wp), parameter :: max_samples = 1.0e5_wp                      ! of the torus; with more a box around it decides
   real(wp), parameter :: max_terms = 2.0e7_wp                        ! of the series at them, for all laws: .2 s
   integer, parameter :: samples_per_part = 4096                      ! samples at one time
   integer, parameter :: samples_at_first = 256                       ! spread over the torus: most motions reach a law there
   real(wp), parameter :: golden_ratio = 0.6180339887498949_wp        ! multiples of it are spread without a pattern

contains

   !> The laws without those that exert no force on a motion, nor on one that is larger or smaller by a margin.
   function reached_laws(laws, motion, margin) result(reached)
      type(law_box_t), intent(in) :: laws(:)                          !! on its degrees of freedom
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: margin                                  !! relative to the motion
      type(law_box_t), allocatable :: reached(:)
      logical :: is_reached(size(laws))
      integer :: i

      is_reached = [(reaches(laws(i)%law, motion, margin, max_terms/size(laws)), i=1, size(laws))]
      reached = laws(pack([(i, i=1, size(laws))], is_reached))
   end function reached_laws

   !> Whether a motion reaches a law: not if it stays, at all samples, in the region without force, which is convex. Laws whose
   !> region may not be convex count as reached, since their force may act between two samples; so do those on velocities and
   !> between surfaces.
   logical function reaches(given, motion, margin, terms)
      class(law_t), intent(in) :: given
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: margin
      real(wp), intent(in) :: terms                                   ! of the series that may be summed up
      class(law_t), allocatable :: law
      complex(wp), allocatable :: amplitudes(:, :)
      integer :: counts(size(motion%tuples, 1)), first, i, n

      reaches = .true.
      if (.not. (has_reach(given) .and. given%has_convex_free_region)) return
      if (given%needs_velocity .or. allocated(given%positions)) return
      allocate (law, source=given)
      call law%prepare(1.0_wp)                                        ! the sign of a force does not depend on it
      amplitudes = matmul(transpose(cmplx(law%shape, 0.0_wp, wp)), motion%amplitudes(law%dofs, :))
      if (2.0_wp**size(amplitudes, 1) <= samples_at_first) then
         reaches = touches(corners_of_box(motion%tuples, amplitudes))
         if (.not. reaches) return
      end if
      counts = samples_of_harmonic*max(1, maxval(abs(motion%tuples), dim=2))
      if (product(real(counts, wp)) > min(max_samples, terms/size(motion%tuples, 2))) return
      n = product(counts)
      if (touches(motion_at(motion%tuples, amplitudes, counts, &
                            [(int(n*modulo(i*golden_ratio, 1.0_wp)), i=1, samples_at_first)]))) return
      do first = 0, n - 1, samples_per_part
         if (touches(motion_at(motion%tuples, amplitudes, counts, [(i, i=first, min(n, first + samples_per_part) - 1)]))) return
      end do
      reaches = .false.

   contains

      logical function touches(z)
         real(wp), intent(in) :: z(:, :)                              !! (places, coordinates)
         real(wp) :: no_rates(size(z, 1), 0)

         touches = .not. exerts_no_force(law, z, no_rates, [1.0_wp/(1.0_wp + margin), 1.0_wp, 1.0_wp + margin])
      end function touches
   end function reaches

   !> Corners of the box that no phase leaves, (corners, coordinates).
   pure function corners_of_box(tuples, amplitudes) result(z)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_coordinates, n_harmonics)
      real(wp) :: z(2**size(amplitudes, 1), size(amplitudes, 1))
      logical :: is_mean(size(tuples, 2))
      integer :: c, i

      is_mean = all(tuples == 0, dim=1)
      do c = 1, size(z, 2)
         associate (mean => sum(real(amplitudes(c, :)), mask=is_mean), extent => sum(abs(amplitudes(c, :)), mask=.not. is_mean))
            z(:, c) = [(merge(mean + extent, mean - extent, btest(i, c - 1)), i=0, size(z, 1) - 1)]
         end associate
      end do
   end function corners_of_box

   !> Coordinates at some of the points of a grid over the torus, (points, coordinates).
   pure function motion_at(tuples, amplitudes, counts, at) result(z)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_coordinates, n_harmonics)
      integer, intent(in) :: counts(:)                                !! points along each tone
      integer, intent(in) :: at(:)                                    !! the points, counted from 0 along the first tone first
      real(wp) :: z(size(at), size(amplitudes, 1))
      complex(wp) :: turns(0:maxval(counts) - 1, size(counts)), waves(size(tuples, 2))
      integer :: i, k, rest

      do k = 1, size(counts)
         turns(:counts(k) - 1, k) = [(exp(cmplx(0.0_wp, two_pi*i/counts(k), wp)), i=0, counts(k) - 1)]
      end do
      do i = 1, size(at)
         rest = at(i)
         waves = 1.0_wp
         do k = 1, size(counts)
            waves = waves*turns(modulo(modulo(rest, counts(k))*tuples(k, :), counts(k)), k)
            rest = rest/counts(k)
         end do
         z(i, :) = real(matmul(amplitudes, waves))
      end do
   end function motion_at
end module hb_reached_laws
