!> The linear structure M x'' + D x' + K x = forces: the result of every builder.
!>
!> D contains all terms that multiply the velocity: viscous (symmetric) and gyroscopic (skew-symmetric). In addition
!> to the matrices there may be parts with frequency-dependent stiffness, which have no equations in time.
module hb_structure
   use hb_error, only: error_t, fail
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: gib, wp
   use hb_lapack, only: dpotrf
   use hb_node_sets, only: named_vectors_t, node_sets_t
   use hb_similar_word, only: closest_word
   use hb_sparse, only: sparse_sum, sparse_t, sparse_transpose
   use hb_structure_checks, only: check_finite, check_mass, check_names, check_sizes, check_sparse_mass, label_length, unit_length
   use hb_text, only: join, parse_integer, to_text
   use hb_thresholds, only: negligible_share
   implicit none
   private
   public :: check_memory_of_structure, label_length, max_dense, max_dofs, max_sparse_dofs, new_structure, structure_t, unit_length

   integer, parameter :: max_dofs = 10000                    !! for readers: dense matrices then take 2.4 GB
   integer, parameter :: max_sparse_dofs = 1000000           !! for readers that make sparse matrices
   integer, parameter :: max_dense = 1000 !! degrees of freedom up to which sparse matrices are converted to dense ones

   !> The matrices of a large structure, as those of `structure_t`.
   type :: sparse_matrices_t
      type(sparse_t) :: mass, damping, stiffness
   end type sparse_matrices_t

   type :: structure_t
      integer :: n_dofs = 0
      real(wp), allocatable :: mass(:, :)                    !! [kg], (n_dofs, n_dofs), symmetric
      real(wp), allocatable :: damping(:, :)                 !! [N s/m], (n_dofs, n_dofs)
      real(wp), allocatable :: stiffness(:, :)               !! [N/m], (n_dofs, n_dofs)
      class(sparse_matrices_t), allocatable :: sparse        !! instead of these three matrices, for many dofs
      type(frequency_part_t), allocatable :: parts(:)        !! with frequency-dependent stiffness, in addition to the matrices
      integer, allocatable :: states(:)                      !! degrees of freedom that are states of a feedback, or not allocated
      character(label_length), allocatable :: labels(:)      !! (n_dofs), unique, such as `v3`
      character(unit_length), allocatable :: units(:)        !! (n_dofs), of the coordinate: `m`, `rad`
      type(node_sets_t) :: sets                              !! names for many degrees of freedom; of models only
      type(named_vectors_t) :: vectors                       !! named loads; of models only
      real(wp) :: up_to = 0.0_wp                             !! [rad/s], highest frequency of the reduction; 0: not reduced
      character(:), allocatable :: model_file                !! file from which it was read; otherwise not allocated
      character(:), allocatable :: origin !! the model from which it was read and its fingerprint; otherwise not allocated
   contains
      procedure :: add_parts => structure_add_parts
      procedure :: append_dofs => structure_append_dofs
      procedure :: change_from => structure_change_from
      procedure :: set_tuple => structure_set_tuple
      procedure :: transposed => structure_transposed
      procedure :: force_in => structure_force_in
      procedure :: check_matrices => structure_check_matrices
      procedure :: damping_times => structure_damping_times
      procedure :: depends_on_tuple => structure_depends_on_tuple
      procedure :: diagonals => structure_diagonals
      procedure :: factorise_mass => structure_factorise_mass
      procedure :: dof_index => structure_dof_index
      procedure :: find_dof => structure_find_dof
      procedure :: find_dofs => structure_find_dofs
      procedure :: has_matrices_of => structure_has_matrices_of
      procedure :: is_beyond_tables => structure_is_beyond_tables
      procedure :: mass_times => structure_mass_times
      procedure :: unpack => structure_unpack
      procedure :: work_in_parts => structure_work_in_parts
   end type structure_t

   interface new_structure
      procedure :: new_dense_structure, new_sparse_structure
   end interface new_structure

contains

   !> Largest memory [byte] used while a structure is read: matrices of the builder, copies here, factors of the mass.
   pure real(wp) function structure_bytes(n_dofs)
      integer, intent(in) :: n_dofs
      real(wp), parameter :: copies_of_matrix = 7.0_wp                ! of a matrix

      structure_bytes = copies_of_matrix*8.0_wp*real(n_dofs, wp)**2
   end function structure_bytes

   !> Fails if the matrices of a structure need more than the limit; for readers, before the matrices are allocated.
   !> Sparse ones are counted by their entries.
   subroutine check_memory_of_structure(n_dofs, error, memory_limit, n_entries)
      integer, intent(in) :: n_dofs
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit                  !! bytes
      integer, intent(in), optional :: n_entries                      !! of all sparse matrices
      real(wp), parameter :: bytes_of_entry = 12.0_wp, copies_of_matrix = 4.0_wp, bytes_of_dof = 200.0_wp
      character(20) :: needed, there
      real(wp) :: bytes

      if (.not. present(memory_limit)) return
      if (present(n_entries) .and. n_dofs > max_dense) then
         bytes = copies_of_matrix*bytes_of_entry*n_entries + bytes_of_dof*n_dofs
         if (bytes <= memory_limit) return
         write (needed, "(f20.2)") bytes/gib
         write (there, "(f20.2)") memory_limit/gib
         call fail(error, "the sparse matrices of "//to_text(n_dofs)//" degrees of freedom would need "// &
                   trim(adjustl(needed))//" GiB of memory while they are read, "//trim(adjustl(there))// &
                   " GiB are available for each process")
         return
      end if
      if (structure_bytes(n_dofs) <= memory_limit) return
      write (needed, "(f20.2)") structure_bytes(n_dofs)/gib
      write (there, "(f20.2)") memory_limit/gib
      call fail(error, "the matrices of "//to_text(n_dofs)//" degrees of freedom would need "//trim(adjustl(needed))// &
                " GiB of memory while they are read, "//trim(adjustl(there))//" GiB are available for each process; at most "// &
                to_text(int(sqrt(memory_limit/structure_bytes(1))))//" would fit")
   end subroutine check_memory_of_structure

   !> Creates a structure from its matrices.
   !>
   !> Fails with the location unless all sizes agree, all numbers are finite, the mass is symmetric and positive
   !> semi-definite, and the labels are unique and begin with a letter.
   subroutine new_dense_structure(self, mass, damping, stiffness, labels, units, error)
      type(structure_t), intent(out) :: self
      real(wp), intent(in) :: mass(:, :)                              !! [kg], (n_dofs, n_dofs)
      real(wp), intent(in) :: damping(:, :)                           !! [N s/m], (n_dofs, n_dofs)
      real(wp), intent(in) :: stiffness(:, :)                         !! [N/m], (n_dofs, n_dofs)
      character(*), intent(in) :: labels(:), units(:)                 !! (n_dofs)
      type(error_t), allocatable, intent(out) :: error

      call check_sizes(size(mass, 1), mass, damping, stiffness, labels, units, error)
      if (allocated(error)) return
      call check_names(labels, units, error)
      if (allocated(error)) return
      call check_finite("mass", mass, labels, error)
      if (allocated(error)) return
      call check_finite("damping", damping, labels, error)
      if (allocated(error)) return
      call check_finite("stiffness", stiffness, labels, error)
      if (allocated(error)) return
      call check_mass(mass, labels, error)
      if (allocated(error)) return

      self%n_dofs = size(mass, 1)
      self%mass = mass
      self%damping = damping
      self%stiffness = stiffness
      allocate (self%labels(self%n_dofs), self%units(self%n_dofs))
      self%labels = labels
      self%units = units
   end subroutine new_dense_structure

   !> Creates a structure from sparse matrices, which remain sparse for more than `max_dense` degrees of freedom.
   !> Fails as for dense ones; an indefinite large mass is detected only at its diagonal and at pairs of degrees of
   !> freedom.
   subroutine new_sparse_structure(self, mass, damping, stiffness, labels, units, error)
      type(structure_t), intent(out) :: self
      type(sparse_t), intent(in) :: mass, damping, stiffness          !! (n_dofs, n_dofs), [kg], [N s/m], [N/m], finite
      character(*), intent(in) :: labels(:), units(:)                 !! (n_dofs)
      type(error_t), allocatable, intent(out) :: error

      if (mass%n_rows <= max_dense) then
         call new_dense_structure(self, mass%dense(), damping%dense(), stiffness%dense(), labels, units, error)
         return
      end if
      if (any([damping%n_rows, stiffness%n_rows, size(labels), size(units)] /= mass%n_rows)) then
         call fail(error, "matrices, labels and units are not all for "//to_text(mass%n_rows)//" degrees of freedom")
         return
      end if
      call check_names(labels, units, error)
      if (.not. allocated(error)) call check_sparse_mass(mass, labels, error)
      if (allocated(error)) return
      self%n_dofs = mass%n_rows
      allocate (self%sparse)
      self%sparse%mass = mass
      self%sparse%damping = damping
      self%sparse%stiffness = stiffness
      allocate (self%labels(self%n_dofs), self%units(self%n_dofs))
      self%labels = labels
      self%units = units
   end subroutine new_sparse_structure

   !> Diagonals of the matrices.
   pure subroutine structure_diagonals(self, mass, damping, stiffness)
      class(structure_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: mass(:), damping(:), stiffness(:)   !! (n_dofs)
      integer :: i

      if (allocated(self%sparse)) then
         mass = self%sparse%mass%diagonal()
         damping = self%sparse%damping%diagonal()
         stiffness = self%sparse%stiffness%diagonal()
      else
         mass = [(self%mass(i, i), i=1, self%n_dofs)]
         damping = [(self%damping(i, i), i=1, self%n_dofs)]
         stiffness = [(self%stiffness(i, i), i=1, self%n_dofs)]
      end if
   end subroutine structure_diagonals

   !> Lower Cholesky factor of a dense mass.
   subroutine structure_factorise_mass(self, factor, singular_at)
      class(structure_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: factor(:, :)              !! (n_dofs, n_dofs)
      integer, intent(out) :: singular_at                             !! degree of freedom at which the mass is singular; 0: none
      real(wp), parameter :: singular_pivot = 1.0e-13_wp              ! a pivot is what is left of the diagonal
      integer :: i

      factor = self%mass
      call dpotrf("L", self%n_dofs, factor, self%n_dofs, singular_at)
      if (singular_at /= 0) return
      do i = 1, self%n_dofs
         if (factor(i, i)**2 <= singular_pivot*self%mass(i, i)) singular_at = i
      end do
   end subroutine structure_factorise_mass

   !> M c.
   pure function structure_mass_times(self, c) result(force)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: c(:)                                 !! (n_dofs)
      complex(wp) :: force(size(c))

      if (allocated(self%sparse)) then
         force = sparse_times(self%sparse%mass, c)
      else
         force = dense_times(self%mass, c)
      end if
   end function structure_mass_times

   !> D c.
   pure function structure_damping_times(self, c) result(force)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: c(:)                                 !! (n_dofs)
      complex(wp) :: force(size(c))

      if (allocated(self%sparse)) then
         force = sparse_times(self%sparse%damping, c)
      else
         force = dense_times(self%damping, c)
      end if
   end function structure_damping_times

   !> Several times faster than the product of real and complex numbers.
   pure function dense_times(a, c) result(product)
      real(wp), intent(in) :: a(:, :)
      complex(wp), intent(in) :: c(:)
      complex(wp) :: product(size(c))
      real(wp), dimension(size(c)) :: imaginary_part, real_part

      real_part = real(c)
      imaginary_part = aimag(c)
      product = cmplx(matmul(a, real_part), matmul(a, imaginary_part), wp)
   end function dense_times

   pure function sparse_times(a, c) result(product)
      type(sparse_t), intent(in) :: a
      complex(wp), intent(in) :: c(:)
      complex(wp) :: product(size(c))
      integer :: e, i

      product = (0.0_wp, 0.0_wp)
      do i = 1, size(c)
         do e = a%first(i), a%first(i + 1) - 1
            product(i) = product(i) + a%value(e)*c(a%column(e))
         end do
      end do
   end function sparse_times

   !> Sets the tuple of the harmonic whose forces are evaluated next.
   pure subroutine structure_set_tuple(self, tuple, further)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! (n_tones)
      integer, intent(in), optional :: further                        !! nodal diameters that are added, of disturbances
      integer :: i

      if (.not. allocated(self%parts)) return
      do i = 1, size(self%parts)
         call self%parts(i)%set_tuple(tuple, further)
      end do
   end subroutine structure_set_tuple

   !> S(w) c, the forces of a motion of one frequency; of a difference of two structures their change.
   pure function structure_force_in(self, c, frequency, drive) result(force)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: c(:)                                 !! a - i b [m], (n_dofs)
      real(wp), intent(in) :: frequency                               !! [rad/s]
      real(wp), intent(in) :: drive                                   !! [rad**2/s**2], see hb_dynamic_stiffness
      complex(wp) :: force(size(c))
      complex(wp) :: dz_dw, z
      integer :: i

      if (allocated(self%sparse)) then
         force = sparse_times(self%sparse%stiffness, c)
      else
         force = dense_times(self%stiffness, c)
      end if
      force = force - cmplx(frequency**2, drive, wp)*self%mass_times(c) + cmplx(0.0_wp, frequency, wp)*self%damping_times(c)
      if (.not. allocated(self%parts)) return
      do i = 1, size(self%parts)
         call self%parts(i)%evaluate(frequency, z, dz_dw)
         force = force + self%parts(i)%acts*(z*sum(self%parts(i)%feels*c))
      end do
   end function structure_force_in

   !> The structure with transposed matrices and parts, without names.
   function structure_transposed(self) result(turned)
      class(structure_t), intent(in) :: self
      type(structure_t) :: turned
      integer :: i

      turned%n_dofs = self%n_dofs
      allocate (turned%labels, source=self%labels)
      allocate (turned%units, source=self%units)
      if (allocated(self%sparse)) then
         turned%sparse = sparse_matrices_t(sparse_transpose(self%sparse%mass), sparse_transpose(self%sparse%damping), &
                                           sparse_transpose(self%sparse%stiffness))
      else
         turned%mass = transpose(self%mass)
         turned%damping = transpose(self%damping)
         turned%stiffness = transpose(self%stiffness)
      end if
      if (.not. allocated(self%parts)) return
      allocate (turned%parts, source=self%parts)
      do i = 1, size(self%parts)
         turned%parts(i)%acts = self%parts(i)%feels
         turned%parts(i)%feels = self%parts(i)%acts
      end do
   end function structure_transposed

   !> Sum of conj(a.c) Z(w) b.c over the parts that depend on the frequency.
   pure complex(wp) function structure_work_in_parts(self, c, frequency) result(work)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: c(:)                                 !! a - i b [m], (n_dofs)
      real(wp), intent(in) :: frequency                               !! [rad/s]
      complex(wp) :: dz_dw, z
      integer :: i

      work = 0.0_wp
      if (.not. allocated(self%parts)) return
      do i = 1, size(self%parts)
         if (self%parts(i)%kind == kind_of_part%neighbour) then       ! what both parts of a copy do is known by its motion
            if (.not. self%parts(i)%is_of_previous) &
               work = work + 2.0_wp*self%parts(i)%stiffness*real(conjg(sum(self%parts(i)%acts*c))*c(self%parts(i)%copy), wp)
            cycle
         end if
         call self%parts(i)%evaluate(frequency, z, dz_dw)
         work = work + conjg(sum(self%parts(i)%acts*c))*z*sum(self%parts(i)%feels*c)
      end do
   end function structure_work_in_parts

   !> Whether a motion has frequencies beyond those of tables of parts, at the coordinates of which it moves: the ends apply there.
   pure logical function structure_is_beyond_tables(self, c, frequencies) result(is_beyond)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: c(:, :)                              !! a - i b [m], (n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      real(wp) :: motion(size(frequencies))
      integer :: i

      is_beyond = .false.
      if (.not. allocated(self%parts)) return
      do i = 1, size(self%parts)
         associate (part => self%parts(i))
            if (part%n_curves == 0) cycle
            motion = abs(matmul(part%feels, c))
            is_beyond = is_beyond .or. any(motion > negligible_share*maxval(motion) .and. &
                                           (abs(frequencies) < part%known(1) .or. abs(frequencies) > part%known(2)))
         end associate
      end do
   end function structure_is_beyond_tables

   !> Adds parts of elements.
   pure subroutine structure_add_parts(self, parts)
      class(structure_t), intent(inout) :: self
      type(frequency_part_t), intent(in) :: parts(:)
      type(frequency_part_t), allocatable :: all_parts(:)

      if (allocated(self%parts)) then
         allocate (all_parts, source=[self%parts, parts])
      else
         allocate (all_parts, source=parts)
      end if
      call move_alloc(all_parts, self%parts)
   end subroutine structure_add_parts

   !> Appends degrees of freedom without mass, damping and stiffness, with labels that begin with a word.
   subroutine structure_append_dofs(self, word, units)
      class(structure_t), intent(inout) :: self
      character(*), intent(in) :: word
      character(*), intent(in) :: units(:)                            !! one for each
      character(label_length), allocatable :: labels(:)
      real(wp), allocatable :: none(:)
      integer :: i, n, n_all

      n = self%n_dofs
      n_all = n + size(units)
      allocate (none(size(units)), source=0.0_wp)
      allocate (labels(n_all))
      labels(:n) = self%labels
      do i = 1, size(units)
         labels(n + i) = free_label(i)
      end do
      call move_alloc(labels, self%labels)
      self%units = [character(unit_length) :: self%units, units]
      self%n_dofs = n_all
      if (allocated(self%parts)) then
         do i = 1, size(self%parts)
            self%parts(i)%acts = [self%parts(i)%acts, none]
            self%parts(i)%feels = [self%parts(i)%feels, none]
         end do
      end if
      if (allocated(self%sparse)) then
         call widen_sparse(self%sparse%mass)
         call widen_sparse(self%sparse%damping)
         call widen_sparse(self%sparse%stiffness)
      else
         call widen(self%mass)
         call widen(self%damping)
         call widen(self%stiffness)
      end if

   contains

      !> Label of number i that no degree of freedom has.
      function free_label(i) result(label)
         integer, intent(in) :: i
         character(label_length) :: label

         label = word//to_text(i)
         do while (any(labels(:n + i - 1) == label))
            label = trim(label)//"_"
         end do
      end function free_label

      subroutine widen(matrix)
         real(wp), allocatable, intent(inout) :: matrix(:, :)
         real(wp), allocatable :: wider(:, :)

         allocate (wider(n_all, n_all), source=0.0_wp)
         wider(:n, :n) = matrix
         call move_alloc(wider, matrix)
      end subroutine widen

      subroutine widen_sparse(matrix)
         type(sparse_t), intent(inout) :: matrix

         matrix%n_rows = n_all
         matrix%n_columns = n_all
         matrix%first = [matrix%first, spread(matrix%first(n + 1), 1, n_all - n)]
      end subroutine widen_sparse
   end subroutine structure_append_dofs

   !> Whether the dynamic stiffness of a harmonic depends on its tuple, as that of a sector does.
   pure logical function structure_depends_on_tuple(self) result(depends)
      class(structure_t), intent(in) :: self

      depends = .false.
      if (allocated(self%parts)) depends = any(self%parts%kind == kind_of_part%neighbour)
   end function structure_depends_on_tuple

   !> Fails for an operation that needs the matrices as they are: if there are too many degrees of freedom, or parts
   !> with frequency-dependent stiffness.
   pure subroutine structure_check_matrices(self, what, most, error, has_parts)
      class(structure_t), intent(in) :: self
      character(*), intent(in) :: what
      integer, intent(in) :: most                                     !! degrees of freedom
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: has_parts                      !! such parts are supported

      if (self%n_dofs > most) call fail(error, what//" supports at most "//to_text(most)// &
                                        " degrees of freedom; the structure has "//to_text(self%n_dofs)// &
                                        ": reduce it (nhbm-model reduce)")
      if (present(has_parts)) return
      if (self%depends_on_tuple()) then
         call fail(error, what//" needs equations in time; a sector has none: solve the whole wheel")
      else if (allocated(self%parts)) then
         if (.not. all(self%parts%is_of_element)) then
            call fail(error, what//" needs equations in time; a dynamic stiffness has none")
         else if (any(self%parts%kind == kind_of_part%coefficients)) then
            call fail(error, what//" needs equations in time; a table over frequencies has none: replace it by a "// &
                      "feedback with states that fit it")
         else
            call fail(error, what//" needs equations in time; a delayed feedback has none")
         end if
      end if
   end subroutine structure_check_matrices

   !> Converts the matrices to dense ones.
   subroutine structure_unpack(self)
      class(structure_t), intent(inout) :: self

      if (.not. allocated(self%sparse)) return
      self%mass = self%sparse%mass%dense()
      self%damping = self%sparse%damping%dense()
      self%stiffness = self%sparse%stiffness%dense()
      deallocate (self%sparse)
   end subroutine structure_unpack

   !> Number of the degree of freedom with this label, or with this number as text (`5`); 0 if there is none.
   pure integer function structure_dof_index(self, label) result(dof)
      class(structure_t), intent(in) :: self
      character(*), intent(in) :: label
      character(len(label)) :: wanted
      integer :: i
      logical :: is_number

      wanted = adjustl(label)
      i = verify(trim(wanted), "0123456789", back=.true.)             ! labels are unique, and most of them are numbered
      call parse_integer(trim(wanted(i + 1:)), dof, is_number)
      if (is_number .and. dof > 0 .and. dof <= self%n_dofs) then
         if (self%labels(dof) == wanted) return
      end if
      do dof = 1, self%n_dofs
         if (self%labels(dof) == wanted) return
      end do
      call parse_integer(trim(wanted), dof, is_number)
      if (dof < 1 .or. dof > self%n_dofs) dof = 0
   end function structure_dof_index

   !> Finds a degree of freedom as `dof_index` does, or the only one of a set such as `disk.x`; fails with the known
   !> labels and the closest one.
   pure subroutine structure_find_dof(self, label, dof, error)
      class(structure_t), intent(in) :: self
      character(*), intent(in) :: label
      integer, intent(out) :: dof
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest, message
      integer, allocatable :: dofs(:)
      integer :: number
      logical :: is_number

      dof = self%dof_index(label)
      if (dof > 0) return
      call self%sets%find(label, dofs, error)
      if (allocated(error)) return
      if (allocated(dofs)) then
         if (size(dofs) == 1) dof = dofs(1)
         if (size(dofs) /= 1) call fail(error, "'"//trim(adjustl(label))//"' stands for "//to_text(size(dofs))// &
                                        " degrees of freedom; one is needed, such as '"//trim(self%labels(dofs(1)))//"'")
         return
      end if
      call parse_integer(trim(adjustl(label)), number, is_number)
      if (is_number) then
         call fail(error, "there is no degree of freedom "//to_text(number)//"; the structure has 1 to "// &
                   to_text(self%n_dofs))
         return
      end if
      message = "unknown degree of freedom '"//trim(adjustl(label))//"'; known: "//trim(known_labels(self%labels))
      closest = trim(closest_word(label, self%labels))
      if (allocated(self%sets%names)) then
         if (size(self%sets%names) > 0) message = message//"; sets: "//trim(known_labels(self%sets%names))
         number = index(label, ".", back=.true.)
         if (len(closest) == 0 .and. number > 1) closest = trim(closest_word(label(:number - 1), self%sets%names))
         if (number > 1 .and. any(self%sets%names == closest) .and. len(closest) > 0) closest = closest//trim(label(number:))
      end if
      if (len(closest) > 0) message = message//"; did you mean '"//closest//"'?"
      call fail(error, message)
   end subroutine structure_find_dof

   !> Finds all degrees of freedom of a name: one as `find_dof` does, or those of a set of nodes such as `contact.z`.
   pure subroutine structure_find_dofs(self, name, dofs, error)
      class(structure_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: dofs(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: dof

      dof = self%dof_index(name)
      if (dof == 0) call self%sets%find(name, dofs, error)
      if (allocated(dofs) .or. allocated(error)) return
      if (dof == 0) call self%find_dof(name, dof, error)
      dofs = [dof]
   end subroutine structure_find_dofs

   !> Whether all matrices and parts are equal to those of another structure, number by number.
   pure logical function structure_has_matrices_of(self, other) result(are_same)
      class(structure_t), intent(in) :: self
      type(structure_t), intent(in) :: other
      integer :: i

      are_same = self%n_dofs == other%n_dofs .and. (allocated(self%sparse) .eqv. allocated(other%sparse)) .and. &
                 (allocated(self%parts) .eqv. allocated(other%parts))
      if (are_same .and. allocated(self%parts)) are_same = size(self%parts) == size(other%parts)
      if (are_same .and. allocated(self%parts)) &
         are_same = all([(self%parts(i)%equals(other%parts(i)), i=1, size(self%parts))])
      if (.not. are_same) return
      if (allocated(self%sparse)) then
         are_same = self%sparse%mass%equal(other%sparse%mass) .and. self%sparse%damping%equal(other%sparse%damping) .and. &
                    self%sparse%stiffness%equal(other%sparse%stiffness)
      else
         are_same = all(self%mass == other%mass) .and. all(self%damping == other%damping) .and. &
                    all(self%stiffness == other%stiffness)
      end if
   end function structure_has_matrices_of

   !> Structure whose matrices and parts are a weight times the difference between this one and another: a derivative
   !> with respect to a value, if the two are neighbours.
   function structure_change_from(self, other, weight) result(change)
      class(structure_t), intent(in) :: self
      class(structure_t), intent(in) :: other
      real(wp), intent(in) :: weight
      type(structure_t) :: change

      change%n_dofs = self%n_dofs
      if (allocated(self%parts) .and. allocated(other%parts)) then
         change%parts = [self%parts, other%parts]
         change%parts%factor = change%parts%factor*[spread(weight, 1, size(self%parts)), spread(-weight, 1, size(other%parts))]
      end if
      if (allocated(self%sparse)) then
         associate (mine => self%sparse, others => other%sparse)
            change%sparse = sparse_matrices_t(sparse_sum(weight, mine%mass, -weight, others%mass), &
                                              sparse_sum(weight, mine%damping, -weight, others%damping), &
                                              sparse_sum(weight, mine%stiffness, -weight, others%stiffness))
         end associate
      else
         change%mass = weight*(self%mass - other%mass)
         change%damping = weight*(self%damping - other%damping)
         change%stiffness = weight*(self%stiffness - other%stiffness)
      end if
   end function structure_change_from

   !> All labels, or the ends of a long list.
   pure function known_labels(labels) result(text)
      character(*), intent(in) :: labels(:)
      integer, parameter :: n_shown = 24, n_at_end = 4
      character((n_shown + 1)*(len(labels) + 2)) :: text

      if (size(labels) <= n_shown) then
         text = join(labels, ", ")
      else
         text = join(labels(:n_shown - n_at_end), ", ")//", ..., "// &
                join(labels(size(labels) - n_at_end + 1:), ", ")
      end if
   end function known_labels
end module hb_structure
