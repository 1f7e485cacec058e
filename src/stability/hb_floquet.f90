!> Computes Floquet multipliers and Lyapunov exponents of motions, and decides on stability.
!>
!> Without laws disturbances obey the equations of the structure, which are constant: its eigenvalues give the multipliers, or a
!> structure that loses energy in all motions is stable. Source: docs/why/theory.md, section 8.
module hb_floquet
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_coordinate_scales, only: coordinate_scales_t, find_coordinate_scales
   use hb_dissipation, only: loses_energy, work_of_dissipation
   use hb_error, only: error_t
   use hb_exponents, only: exponents_t, find_exponents, periods_of_beats, propagation_t, work_of_exponents
   use hb_hill, only: assess_by_hill, has_determinant, work_of_hill
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_linear_propagation, only: linear_propagation_t, new_linear_propagation
   use hb_map_eigenvalues, only: deflate_all, eigenvalues_of, shifts_of_eigenvalues, sort_by_size
   use hb_monodromy, only: find_monodromy, monodromy_t, work_of_monodromy, work_of_transfer
   use hb_noise_response, only: find_noise_response
   use hb_null_space, only: find_null_space
   use hb_piecewise_orbit, only: find_piecewise_orbit, has_piecewise_orbit, piecewise_orbit_t, work_of_piecewise_orbit
   use hb_stability, only: excitation_t, few_periods, harmonic_motion_t, max_multipliers, noise_status, share_of_stability, &
      stability_config_t, stability_finder_t, stability_method, stability_t, unknown_because, verdict, work_of_verdict
   use hb_structure, only: structure_t
   use hb_thresholds, only: certainty_factor, estimate_safety, negligible_share, rounding_level, small_share
   use hb_torus_multipliers, only: find_torus_multipliers, has_torus_multipliers, tone_of_maps
   use hb_variation, only: min_work, new_variation, variation_t
   implicit none
   private
   public :: assess_exponents, assess_matrix, floquet_t, free_motions, has_to_be_integrated, least_work, stability_of_map, &
      work_on_demand

   real(wp), parameter :: error_of_map = 1.0e-8_wp                    ! of a derivative by differences of high order, relative
   real(wp), parameter :: patience_of_points = 1.0_wp                 ! more is that of curves, which compare multipliers
   integer, parameter :: doublings_of_record = 4                      ! where its halves differ

   real(wp), parameter :: largest_surge = log(100.0_wp) ! a disturbance of 1 % grows to the size of the motion before it decays
   real(wp), parameter :: max_work_of_orbit = 1.0e8_wp               ! in about a nanosecond; high modes need more, and the
                                                                      ! series is used for them: with a minute
                                                                      ! inputs/gallery/beam_stop_peak.nml takes 24 s, not 0.5 s
   real(wp), parameter :: least_work = 4.0e6_wp                       !! in about a nanosecond: for any motion
   real(wp), parameter :: work_on_demand = 6.0e10_wp                  !! in about a nanosecond: a minute
   real(wp), parameter :: max_turns = 1.0e6_wp                       ! of the fastest harmonic in a period of the slowest
                                                                      !! tone: the samples of a period are stored, and counted
                                                                      !! by default integers

   type, extends(stability_finder_t) :: floquet_t
      real(wp) :: work_in_any_case = least_work                       !! [ns] that `auto` may always use for a motion
   contains
      procedure :: find => floquet_find
      procedure :: max_work => floquet_max_work
   end type floquet_t

   !> A motion of a model whose coordinates may be compared, and what acts on it.
   type :: scaled_motion_t
      type(structure_t) :: structure
      type(law_box_t), allocatable :: laws(:)
      type(harmonic_motion_t) :: motion
      type(excitation_t) :: excitation
   end type scaled_motion_t

contains

   !> From the equations linearised along the motion; no result if a law has none.
   subroutine floquet_find(self, stability, config, motion, structure, laws, excitation, work_allowed)
      class(floquet_t), intent(in) :: self
      type(stability_t), intent(out) :: stability
      type(stability_config_t), intent(in) :: config
      type(harmonic_motion_t), intent(in) :: motion
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(variation_t), target :: variation
      type(coordinate_scales_t) :: scales
      type(scaled_motion_t) :: scaled
      real(wp) :: limit
      integer :: n_transfers                                          ! at least, for a verdict

      if (config%method == stability_method%off) return
      if (has_to_be_integrated(laws)) stability%reason = unknown_because%no_equations
      if (allocated(structure%sparse)) stability%reason = unknown_because%too_large
      if (stability%reason == unknown_because%too_large .and. has_noise(excitation)) &
         stability%response%status = noise_status%too_costly
      if (stability%reason /= unknown_because%none) return
      limit = self%max_work(config, work_allowed)
      if (has_noise(excitation)) limit = huge(1.0_wp)                 ! its response was requested, which needs the verdict
      if (size(laws) == 0 .and. .not. allocated(structure%parts)) then
         call assess_structure(stability, config, structure, motion, excitation, limit)
         if (has_noise(excitation) .and. stability%response%status == noise_status%none .and. &
             stability%verdict == verdict%stable) stability%response%status = noise_status%too_costly ! without its eigenvalues
         return
      end if
      n_transfers = 1
      if (motion%tones%n_tones > 1) n_transfers = min(config%min_periods, few_periods)
      if (n_transfers*min_work(structure%n_dofs) > limit) then        ! any motion: the mass matrix is then not inverted
         stability%reason = unknown_because%too_costly
         return
      end if
      if (allocated(structure%parts)) then
         call assess_with_parts(stability, variation, motion, structure, laws, limit)
         return
      end if
      call find_coordinate_scales(scales, structure, laws, minval(abs(motion%tones%omega)), sum(abs(motion%amplitudes), dim=2))
      scaled%structure = scales%scaled_structure(structure)
      allocate (scaled%laws, source=scales%scaled_laws(laws))
      scaled%motion = scaled_motion(motion, scales%coordinates)
      scaled%excitation = scaled_excitation(excitation, scales%coordinates)
      call assess_scaled(stability, config, scaled, limit)
      call stability%response%scale(scales%coordinates)
   end subroutine floquet_find

   subroutine assess_scaled(self, config, scaled, limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(scaled_motion_t), intent(in) :: scaled
      real(wp), intent(in) :: limit                                   !! of the work [ns]
      type(variation_t), target :: variation
      type(error_t), allocatable :: error

      associate (motion => scaled%motion)
         call new_variation(variation, scaled%structure, scaled%laws, motion%tuples, motion%tones%omega, motion%amplitudes, error)
         if (allocated(error)) then
            self%reason = unknown_because%no_equations
            return
         end if
         associate (highest => max(maxval(abs(variation%motion%frequencies)), variation%detection_frequency))
            if (highest > max_turns*minval(motion%tones%omega)) self%reason = unknown_because%too_many_cycles
         end associate
         if (self%reason /= unknown_because%none .and. has_noise(scaled%excitation)) self%response%status = noise_status%too_costly
         if (self%reason /= unknown_because%none) return
         if (motion%tones%n_tones == 1) then
            call assess_one_tone(self, config, variation, scaled, limit)
         else
            call assess_torus(self, config, variation, scaled, limit)
         end if
      end associate
      if (has_noise(scaled%excitation)) call add_noise(self, config, variation, scaled)
   end subroutine assess_scaled

   pure logical function has_noise(excitation) result(has)
      type(excitation_t), intent(in) :: excitation

      has = .false.
      if (allocated(excitation%noise)) has = size(excitation%noise) > 0
   end function has_noise

   !> Adds what noise causes about a stable motion.
   subroutine add_noise(self, config, variation, scaled)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      type(scaled_motion_t), intent(in) :: scaled
      complex(wp), allocatable :: shifts(:, :, :)
      real(wp), allocatable :: shift(:), unbounded(:, :)

      allocate (shift(0))
      allocate (unbounded, source=free_motions(scaled%structure, scaled%laws))
      associate (motion => scaled%motion)
         self%response%status = noise_status%no_verdict
         if (self%verdict == verdict%unstable) self%response%status = noise_status%unstable
         if (is_left_out(self)) self%response%status = noise_status%too_costly
         if (self%verdict /= verdict%stable .or. .not. allocated(self%exponents)) return
         self%response%status = noise_status%unbounded
         if (size(unbounded, 2) > 0) return
         self%response%status = noise_status%several_tones
         if (motion%tones%n_tones > 1 .and. any(motion%tones%is_unknown)) return
         if (any(motion%tones%is_unknown)) then
            shifts = shifts_of(variation, motion%amplitudes, motion%tones%is_unknown, unbounded)
            shift = real(sum(shifts(:2*variation%n_dofs, :, 1), dim=2))
         end if
         call find_noise_response(self%response, variation, scaled%structure, scaled%excitation%noise, shift, &
                                  -self%exponents(1), config, work_on_demand)
      end associate
   end subroutine add_noise

   !> The motion of scaled coordinates.
   pure type(harmonic_motion_t) function scaled_motion(motion, scale) result(scaled)
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: scale(:)                                !! of each coordinate, (n_dofs)
      integer :: h

      scaled = motion
      do h = 1, size(scaled%amplitudes, 2)
         scaled%amplitudes(:, h) = scaled%amplitudes(:, h)/scale
      end do
   end function scaled_motion

   !> The loads on scaled coordinates, whose powers remain as they are.
   pure type(excitation_t) function scaled_excitation(excitation, scale) result(scaled)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: scale(:)                                !! of each coordinate, (n_dofs)
      integer :: h

      scaled = excitation
      if (has_noise(excitation)) scaled%noise = scaled%noise*spread(scale, 2, size(scaled%noise, 2))
      if (.not. allocated(scaled%loads%values)) return
      do h = 1, size(scaled%loads%values, 2)
         scaled%loads%values(:, h) = scaled%loads%values(:, h)*scale
      end do
   end function scaled_excitation

   !> Of a periodic motion: from a periodic motion of its pieces, where this is possible and cheap, otherwise from its series.
   subroutine assess_one_tone(self, config, variation, scaled, limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      type(scaled_motion_t), intent(in) :: scaled
      real(wp), intent(in) :: limit                                   !! of the work [ns]
      real(wp) :: work
      logical :: is_orbit_sought

      work = work_of_monodromy(variation)
      if (work > limit) then
         self%reason = unknown_because%too_costly
         return
      end if
      self%method = stability_method%integration
      is_orbit_sought = .false.
      if (.not. scaled%motion%tones%is_unknown(1)) is_orbit_sought = has_piecewise_orbit(variation)
      if (is_orbit_sought) is_orbit_sought = work + work_of_piecewise_orbit(variation) <= min(limit, max_work_of_orbit)
      if (is_orbit_sought) then
         call assess_orbit(self, config, variation, scaled, free_motions(scaled%structure, scaled%laws))
      else
         call assess_period(self, config, variation, scaled%motion%amplitudes, scaled%motion%tones%is_unknown(1), &
                            free_motions(scaled%structure, scaled%laws), limit)
      end if
   end subroutine assess_one_tone

   !> Stability of a structure on which no law acts. Its eigenvalues are found if they take little time beside that of a point, or
   !> were requested, or serve a curve, or if energy does not show that it is stable.
   subroutine assess_structure(self, config, structure, motion, excitation, limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(structure_t), intent(in) :: structure
      type(harmonic_motion_t), intent(in) :: motion
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: limit                                   !! of work, in about a nanosecond
      real(wp), parameter :: work_of_eigenvalues = 10.0_wp            ! by the third power of the size
      real(wp), parameter :: of_a_curve = 5.0_wp                      ! up to 60 degrees of freedom, whose elimination takes as long
      real(wp), parameter :: max_log_growth = 0.9_wp*log(huge(1.0_wp)) ! growth within a period, as a logarithm
      type(law_box_t) :: none(0)
      type(coordinate_scales_t) :: scales
      type(structure_t) :: scaled
      type(variation_t) :: variation
      type(error_t), allocatable :: error
      complex(wp), allocatable :: rates(:)
      real(wp), allocatable :: directions(:, :), matrix(:, :)
      real(wp) :: at_once, work
      integer, allocatable :: retained(:)
      integer :: i

      work = work_of_eigenvalues*(2.0_wp*structure%n_dofs)**3
      at_once = small_share*least_work
      if (config%patience > share_of_stability) at_once = of_a_curve*least_work
      if (limit >= huge(limit)) at_once = work_on_demand
      if (work > at_once) then
         if (work_of_dissipation(structure%n_dofs) <= limit) then
            if (loses_energy(structure)) then
               self%method = stability_method%integration
               self%verdict = verdict%stable
               return
            end if
         end if
         if (work > min(limit, work_on_demand)) then
            self%reason = unknown_because%too_costly
            return
         end if
      end if
      call find_coordinate_scales(scales, structure, none, minval(abs(motion%tones%omega)), sum(abs(motion%amplitudes), dim=2))
      scaled = scales%scaled_structure(structure)
      call new_variation(variation, scaled, none, motion%tuples, motion%tones%omega, motion%amplitudes, error)
      self%reason = unknown_because%no_equations                      ! unless they follow
      if (allocated(error)) return
      self%reason = unknown_because%none
      matrix = variation%constant
      directions = states_of(free_motions(scaled, none), size(matrix, 1))
      if (allocated(variation%massless)) then
         retained = pack([(i, i=1, size(matrix, 1))], .not. variation%massless%is_inert)
         matrix = matrix(retained, retained)
         directions = directions(retained, :)
      end if
      if (.not. all(ieee_is_finite(matrix))) return
      call deflate_all(matrix, directions)
      call eigenvalues_of(matrix, rates)
      if (size(rates) == 0) return
      self%method = stability_method%integration
      associate (omega => minval(motion%tones%omega))
         self%estimate = epsilon(1.0_wp)*variation%norm*two_pi/omega
         rates = rates*two_pi/omega
         rates = exp(cmplx(min(real(rates), max_log_growth), aimag(rates), wp))
         call sort_by_size(rates)
         call assess_multipliers(self, rates, omega)
      end associate
      if (motion%tones%n_tones > 1 .and. allocated(self%multipliers)) deallocate (self%multipliers)
      if (.not. has_noise(excitation)) return
      call add_noise(self, config, variation, scaled_motion_t(scaled, none, scaled_motion(motion, scales%coordinates), &
                                                              scaled_excitation(excitation, scales%coordinates)))
      call self%response%scale(scales%coordinates)
   end subroutine assess_structure

   !> Stability with parts whose stiffness depends on the frequency: of one tone, under laws without memory.
   subroutine assess_with_parts(self, variation, motion, structure, laws, max_work)
      type(stability_t), intent(inout) :: self
      type(variation_t), intent(inout) :: variation
      type(harmonic_motion_t), intent(in) :: motion
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(structure_t) :: bare
      type(error_t), allocatable :: error

      self%reason = unknown_because%no_equations                      ! unless they follow
      if (motion%tones%n_tones > 1 .or. .not. has_determinant(structure%parts, motion%tones%omega(1))) return
      bare = structure
      deallocate (bare%parts)
      call new_variation(variation, bare, laws, motion%tuples, motion%tones%omega, motion%amplitudes, error)
      if (allocated(error)) return
      if (variation%n_states > 0) return
      self%reason = unknown_because%none
      if (work_of_hill(variation, structure) > max_work) then
         self%reason = unknown_because%too_costly
      else
         call assess_by_hill(self, variation, structure, motion%tones%is_unknown(1))
      end if
   end subroutine assess_with_parts

   !> Displacements on which no force depends, (n_dofs, any): motions that differ by them are equivalent.
   pure function free_motions(structure, laws) result(motions)
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)                          !! on its degrees of freedom
      real(wp), allocatable :: motions(:, :)
      real(wp), allocatable :: at_laws(:, :), combinations(:, :)
      real(wp) :: scale(structure%n_dofs), threshold
      logical :: is_dependent(structure%n_dofs)
      integer :: i, k

      allocate (motions(structure%n_dofs, 0))
      if (.not. allocated(structure%stiffness)) return
      scale = [(abs(structure%stiffness(i, i)), i=1, size(scale))]
      scale = merge(1.0_wp/sqrt(max(scale, tiny(1.0_wp))), 1.0_wp, scale > 0.0_wp)
      threshold = 100*real(size(scale), wp)*epsilon(1.0_wp)
      call find_null_space(structure%stiffness*spread(scale, 1, size(scale))*spread(scale, 2, size(scale)), threshold, &
                           is_dependent, motions)
      if (size(motions, 2) == 0) return
      motions = motions*spread(scale, 2, size(motions, 2))
      do k = 1, size(motions, 2)
         motions(:, k) = motions(:, k)/norm2(motions(:, k))
      end do
      allocate (at_laws(size(motions, 2), 0))                         ! and of these those that do not displace a law
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (.not. law%needs_displacement) cycle
            if (allocated(law%positions)) then
               do k = 1, size(law%positions, 2)
                  at_laws = reshape([at_laws, matmul(transpose(motions(law%positions(:, k), :)), law%shape)], &
                                    [size(at_laws, 1), size(at_laws, 2) + size(law%shape, 2)])
               end do
            else
               at_laws = reshape([at_laws, matmul(transpose(motions(law%dofs, :)), law%shape)], &
                                 [size(at_laws, 1), size(at_laws, 2) + size(law%shape, 2)])
            end if
         end associate
      end do
      call find_null_space(transpose(at_laws), threshold, is_dependent(:size(motions, 2)), combinations)
      motions = matmul(motions, combinations)
   end function free_motions

   !> Permitted work in about a nanosecond; unlimited if requested explicitly. A verdict may take it twice: a second time
   !> for the motion of the error estimate.
   pure real(wp) function floquet_max_work(self, config, work_allowed) result(limit)
      class(floquet_t), intent(in) :: self
      type(stability_config_t), intent(in) :: config
      real(wp), intent(in) :: work_allowed                            !! as for a typical point

      limit = huge(1.0_wp)
      if (config%method == stability_method%auto) &
         limit = max(config%patience*work_allowed, work_of_verdict(config%work_spent, self%work_in_any_case))
   end function floquet_max_work

   !> Disturbances by shifts of the phases of unknown tones and by free motions, as series, (size of the state, n_harmonics, any).
   pure function shifts_of(variation, amplitudes, is_unknown, free) result(shifts)
      type(variation_t), intent(in) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_unknown(:)
      real(wp), intent(in) :: free(:, :)                              !! (n_dofs, any); none without a mean value in the series
      complex(wp), allocatable :: shifts(:, :, :)
      integer :: h, k, m, mean, n

      n = size(amplitudes, 1)
      mean = findloc(all(variation%motion%tuples == 0, dim=1), .true., dim=1)
      allocate (shifts(variation%size, size(amplitudes, 2), count(is_unknown) + merge(size(free, 2), 0, mean > 0)), &
                source=(0.0_wp, 0.0_wp))
      do k = count(is_unknown) + 1, size(shifts, 3)
         shifts(:n, mean, k) = free(:, k - count(is_unknown))
      end do
      k = 0
      do m = 1, size(is_unknown)
         if (.not. is_unknown(m)) cycle
         k = k + 1
         do h = 1, size(amplitudes, 2)
            shifts(:n, h, k) = (0.0_wp, 1.0_wp)*variation%motion%tuples(m, h)*amplitudes(:, h)
            shifts(n + 1:2*n, h, k) = (0.0_wp, 1.0_wp)*variation%motion%frequencies(h)/variation%scale*shifts(:n, h, k)
            if (.not. allocated(variation%massless)) cycle
            where (variation%massless%is_inert) shifts(:2*n, h, k) = (0.0_wp, 0.0_wp)
         end do
      end do
   end function shifts_of

   !> Exponents of a motion of several tones.
   subroutine assess_torus(self, config, variation, scaled, limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout), target :: variation
      type(scaled_motion_t), intent(in) :: scaled
      real(wp), intent(in) :: limit                                   !! of the work [ns]
      type(linear_propagation_t) :: propagation
      type(stability_config_t) :: how
      complex(wp), allocatable :: multipliers(:), shifts(:, :, :)
      real(wp) :: error, work_left

      how = config
      associate (motion => scaled%motion)
         allocate (shifts, source=shifts_of(variation, motion%amplitudes, motion%tones%is_unknown, &
                                            free_motions(scaled%structure, scaled%laws)))
      end associate
      call new_linear_propagation(propagation, variation, shifts, how%tolerance)
      if (config%patience > patience_of_points .and. .not. propagation%has_slow_phase .and. &
          has_torus_multipliers(variation) .and. (variation%is_smooth() .or. config%method /= stability_method%auto)) then
         call find_torus_multipliers(variation, shifts, config%tolerance, min(limit, work_on_demand), multipliers, error)
         if (allocated(multipliers)) call adopt_multipliers()
         if (allocated(self%multipliers)) return
      end if
      work_left = limit                                               ! exponents serve no events: the work of a point
      if (config%patience > patience_of_points) &
         work_left = min(limit, max(share_of_stability/config%patience*limit, work_of_verdict(config%work_spent, least_work)))
      if (limit >= huge(limit)) work_left = limit
      call plan_record()
      if (self%reason /= unknown_because%none) return
      self%method = stability_method%integration
      call assess_exponents(self, propagation, min(work_left, work_on_demand), how)

   contains

      !> Derives stability from multipliers, whose error is that of all.
      subroutine adopt_multipliers()
         if (size(multipliers) == 0) return
         self%method = stability_method%integration
         self%noise = error
         associate (omega => scaled%motion%tones%omega(tone_of_maps(scaled%motion%tuples)))
            call assess_multipliers(self, multipliers, omega)
            self%estimate = error*omega/two_pi
         end associate
      end subroutine adopt_multipliers

      !> Makes the record as long as the beats of the motion require, and no longer than necessary if the limit is too low for more.
      subroutine plan_record()
         real(wp) :: work

         associate (work_of_period => work_of_transfer(variation, two_pi/minval(scaled%motion%tones%omega)), necessary => &
                    periods_of_beats(scaled%motion%tuples, scaled%motion%tones%omega, scaled%motion%amplitudes))
            how%min_periods = max(how%min_periods, necessary)
            how%max_periods = max(how%max_periods, doublings_of_record*necessary)
            work = work_of_exponents(work_of_period, how%min_periods)
            if (work > work_left .and. config%method == stability_method%auto) then
               how%min_periods = min(how%min_periods, max(few_periods, necessary))
               work = work_of_exponents(work_of_period, how%min_periods)
            end if
         end associate
         if (work > work_left) self%reason = unknown_because%too_costly
      end subroutine plan_record
   end subroutine assess_torus

   !> Propagates disturbances period by period, and derives the verdict from their growth.
   subroutine assess_exponents(self, propagation, max_work, config)
      type(stability_t), intent(inout) :: self
      class(propagation_t), intent(inout) :: propagation
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(stability_config_t), intent(in) :: config
      type(exponents_t) :: found
      real(wp) :: margin

      call find_exponents(found, propagation, max_work, config%min_periods, config%max_periods)
      if (found%is_cut_short) self%reason = unknown_because%too_costly
      if (.not. allocated(found%rate)) return
      self%reason = unknown_because%none
      self%exponents = found%rate(:min(size(found%rate), max_multipliers))
      self%estimate = found%spread(1)
      self%n_periods = found%n_periods
      margin = max(estimate_safety*found%spread(1), rounding_level*two_pi/propagation%length)
      if (found%is_resolved) self%n_unstable = count(found%rate > estimate_safety*found%spread .and. found%rate > margin)
      if (.not. found%is_resolved) then
         self%reason = merge(unknown_because%too_costly, unknown_because%at_limit, found%is_cut_short)
      else if (self%n_unstable > 0) then
         self%verdict = verdict%unstable
      else if (propagation%surge > largest_surge) then                ! stable only for disturbances that are too small to matter
         call self%withdraw(unknown_because%growing)
         self%growth = exp(propagation%surge)
      else if (maxval(found%rate) < -margin) then
         self%verdict = verdict%stable
      else
         self%reason = merge(unknown_because%too_costly, unknown_because%at_limit, found%is_cut_short)
      end if
   end subroutine assess_exponents

   !> Multipliers of the periodic motion next to the given one under laws of piecewise constant slope; none but those along the
   !> series if there is none. Those of a truncated motion may be inaccurate although the motion is not, because they depend on
   !> the times at which contact begins and ends.
   subroutine assess_orbit(self, config, variation, scaled, free)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      type(scaled_motion_t), intent(in) :: scaled
      real(wp), intent(in) :: free(:, :)                              !! motions that do not count, (n_dofs, any)
      type(piecewise_orbit_t) :: orbit
      type(stability_t) :: along_series

      call find_piecewise_orbit(orbit, variation, scaled%structure, scaled%motion%amplitudes, scaled%excitation, free)
      self%estimate = 1.0_wp                                          ! the series is too far from any periodic motion
      if (.not. orbit%is_found) then
         call assess_period(along_series, config, variation, scaled%motion%amplitudes, .false., free, 0.0_wp)
         if (along_series%verdict == verdict%unstable) call move_alloc(along_series%multipliers, self%along_series)
         self%reason = unknown_because%inaccurate
         return
      end if
      self%is_integrated = .true.
      self%estimate = orbit%estimate
      call deflate_all(orbit%matrix, states_of(free, size(orbit%matrix, 1)))
      call assess_matrix(self, orbit%matrix, variation%motion%omega(1))
   end subroutine assess_orbit

   !> Multipliers of a periodic motion.
   subroutine assess_period(self, config, variation, amplitudes, is_free, free, max_work)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: amplitudes(:, :)
      logical, intent(in) :: is_free                                  !! the tone is unknown
      real(wp), intent(in) :: free(:, :)                              !! motions that do not count, (n_dofs, any)
      real(wp), intent(in) :: max_work                                !! in about a nanosecond, beyond a first result
      real(wp), parameter :: min_matrix_tolerance = 1.0e-12_wp        ! tolerance of the matrix
      real(wp), parameter :: work_of_finer = 4.0_wp                   ! of a matrix with six digits more, relative
      type(monodromy_t) :: monodromy
      complex(wp), allocatable :: shifts(:, :, :)
      real(wp), allocatable :: neutral(:, :), shift(:)
      integer, allocatable :: retained(:)
      integer :: i
      logical :: is_sensitive
      real(wp) :: none(size(amplitudes, 1), 0), tolerance

      tolerance = config%tolerance
      do
         call find_monodromy(monodromy, variation, 0.0_wp, tolerance, work_on_demand)
         if (monodromy%estimate >= huge(1.0_wp)) return               ! cancelled
         self%estimate = monodromy%estimate
         if (.not. all(ieee_is_finite(monodromy%matrix))) return
         call leave_out_neutral()
         call assess_matrix(self, monodromy%matrix, variation%motion%omega(1), monodromy%estimate, is_sensitive)
         if (.not. is_sensitive .or. monodromy%estimate > tolerance .or. tolerance <= min_matrix_tolerance) exit
         if (work_of_finer*monodromy%work > max_work) exit
         tolerance = max(min_matrix_tolerance, negligible_share*tolerance) ! two multipliers nearly coincide on the unit circle
      end do

   contains

      !> Leaves out what a period does not change, and displacements without mass.
      subroutine leave_out_neutral()
         neutral = states_of(free, size(monodromy%matrix, 1))
         if (is_free) then
            shifts = shifts_of(variation, amplitudes, [.true.], none)
            shift = real(sum(shifts(:size(monodromy%matrix, 1), :, 1), dim=2))
            if (variation%n_states > 0) shift = matmul(monodromy%matrix, shift)   ! sliders are included
            self%estimate = max(self%estimate, norm2(matmul(monodromy%matrix, shift) - shift)/norm2(shift))
            neutral = reshape([neutral, shift], [size(shift), size(neutral, 2) + 1])
         end if
         if (allocated(variation%massless)) then
            retained = [pack([(i, i=1, 2*variation%n_dofs)], .not. variation%massless%is_inert), &
                        [(i, i=2*variation%n_dofs + 1, size(neutral, 1))]]
            monodromy%matrix = monodromy%matrix(retained, retained)
            neutral = neutral(retained, :)
         end if
         call deflate_all(monodromy%matrix, neutral)
      end subroutine leave_out_neutral
   end subroutine assess_period

   !> Stability from the derivative of a period map by shooting; without multipliers if LAPACK fails.
   type(stability_t) function stability_of_map(matrix, omega) result(stability)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(in) :: omega                                   !! [rad/s]

      stability%method = stability_method%integration
      stability%is_integrated = .true.
      stability%estimate = error_of_map
      call assess_matrix(stability, matrix, omega)
      if (.not. allocated(stability%multipliers)) allocate (stability%multipliers(0))
   end function stability_of_map

   !> Stores the multipliers of a monodromy matrix and derives the verdict, with the present estimate.
   subroutine assess_matrix(self, matrix, omega, matrix_error, is_sensitive)
      type(stability_t), intent(inout) :: self
      real(wp), intent(in) :: matrix(:, :)
      real(wp), intent(in) :: omega                                   !! [rad/s]
      real(wp), intent(in), optional :: matrix_error                  !! relative to its largest entry, or 1; default: rounding
      logical, intent(out), optional :: is_sensitive                  !! the error prevents a verdict because multipliers nearly
                                                                      !! coincide, and move by its square root
      complex(wp), allocatable :: multipliers(:)
      integer :: first, n_first

      if (present(is_sensitive)) is_sensitive = .false.
      call eigenvalues_of(matrix, multipliers)
      if (size(multipliers) == 0) return
      if (.not. present(matrix_error)) then
         call assess_multipliers(self, multipliers, omega)
         return
      end if
      self%noise = matrix_error*max(1.0_wp, abs(multipliers(1)))
      call assess_multipliers(self, multipliers, omega)
      first = self%verdict
      n_first = self%n_unstable
      if (first == verdict%unknown) return
      associate (error => estimate_safety*matrix_error*max(1.0_wp, maxval(abs(matrix))))
         if (all(abs(abs(multipliers) - 1.0_wp) > sqrt(error)*max(1.0_wp, maxval(abs(matrix))))) return
         call assess_multipliers(self, multipliers, omega, shifts_of_eigenvalues(matrix, multipliers, error))
      end associate
      if (present(is_sensitive)) is_sensitive = self%verdict /= first
      if (self%verdict == first) self%n_unstable = n_first
   end subroutine assess_matrix

   !> Stores multipliers, the largest first, and derives the verdict, with the present estimate.
   subroutine assess_multipliers(self, multipliers, omega, shifts)
      type(stability_t), intent(inout) :: self
      complex(wp), allocatable, intent(inout) :: multipliers(:)
      real(wp), intent(in) :: omega                                   !! [rad/s]
      real(wp), intent(in), optional :: shifts(:)                     !! their errors, if these are larger than those of the matrix
      real(wp), allocatable :: margins(:)
      real(wp) :: noise

      noise = certainty_factor*epsilon(1.0_wp)*abs(multipliers(1))    ! of all others
      allocate (margins(size(multipliers)), source=max(rounding_level, certainty_factor*self%estimate, noise, &
            certainty_factor*self%noise))
      if (present(shifts)) margins = max(margins, shifts)
      if (noise >= small_share) margins = pack(margins, abs(multipliers) >= noise)
      if (noise >= small_share) multipliers = pack(multipliers, abs(multipliers) >= noise)
      self%n_unstable = count(abs(multipliers) > 1.0_wp + margins)
      self%verdict = verdict%unknown
      self%reason = unknown_because%none
      if (self%n_unstable > 0) then
         self%verdict = verdict%unstable
      else if (all(abs(multipliers) < 1.0_wp - margins)) then
         self%verdict = verdict%stable
      else
         self%reason = unknown_because%at_limit
      end if
      self%multipliers = multipliers(:min(size(multipliers), max_multipliers))
      self%exponents = log(max(abs(self%multipliers), tiny(1.0_wp)))*omega/two_pi
   end subroutine assess_multipliers

   !> Whether a law passes events that have no linearised equations here: rigid laws, and sliders without bounds.
   pure logical function has_to_be_integrated(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      has_to_be_integrated = .false.
      do i = 1, size(laws)
         select type (law => laws(i)%law)
         class is (hysteretic_law_t)
            has_to_be_integrated = has_to_be_integrated .or. .not. law%has_bounds
         end select
         has_to_be_integrated = has_to_be_integrated .or. laws(i)%law%is_multiplier
      end do
   end function has_to_be_integrated

   !> Whether the verdict was left out for its work.
   pure logical function is_left_out(stability)
      type(stability_t), intent(in) :: stability

      is_left_out = any(stability%reason == [unknown_because%too_costly, unknown_because%too_many_cycles])
   end function is_left_out

   !> States of displacements, (n, any).
   pure function states_of(displacements, n) result(states)
      real(wp), intent(in) :: displacements(:, :)                     !! (n_dofs, any)
      integer, intent(in) :: n
      real(wp) :: states(n, size(displacements, 2))

      states = 0.0_wp
      states(:size(displacements, 1), :) = displacements
   end function states_of
end module hb_floquet
